/* Charts as SVG files: a page, shapes, text and colours. axis.h adds axes, curves and legends; labels.h places names.
 * Positions and sizes are in px, y points down. Values that are not finite are left out. Use a chart from one thread.
 */
#ifndef CONURB_CHART_CHART_H
#define CONURB_CHART_CHART_H
#include "conurb/base.h"
#include <locale.h>
#include <stdio.h>

#define CN_CHART_INK "#222"
#define CN_CHART_GREY "#666"
#define CN_CHART_RED "#b3001b"

typedef struct cn_chart {
    FILE *out; /* in memory until the chart is saved */
    char *text;
    size_t size;
    locale_t before; /* the caller's locale: numbers in SVG have a dot */
    uint32_t n_clips;
} cn_chart;

/* Between open and save, printf of this thread writes a decimal point. CN_ERR_NOMEM. */
CN_NODISCARD cn_status cn_chart_open(cn_chart *chart);
typedef struct cn_chart_page {
    const char *title;
    double width, height;
} cn_chart_page;
/* Writes the file atomically, and frees the chart, also on failure. CN_ERR_NOMEM, CN_ERR_IO. */
CN_NODISCARD cn_status cn_chart_save(cn_chart *chart, const cn_chart_page *page, const char *path);
/* As save, but the drawing goes into a file that is open, such as an HTML page. CN_ERR_NOMEM. */
CN_NODISCARD cn_status cn_chart_print(cn_chart *chart, const cn_chart_page *page, FILE *out);
void cn_chart_discard(cn_chart *chart); /* in place of saving; safe after it */

typedef struct cn_box {
    double x0, y0, x1, y1;
} cn_box;
bool cn_box_overlap(const cn_box *a, const cn_box *b);

typedef struct cn_paint {
    const char *fill, *stroke; /* "#rrggbb"; NULL: none */
    double opacity;            /* of the fill; 0 stands for 1 */
    double width;              /* of the stroke; 0 stands for 1 */
    bool dashed;
} cn_paint;

/* Colour i of a palette for colour-blind readers; it repeats after eight. */
const char *cn_chart_colour(uint32_t i);
void cn_chart_rect(const cn_chart *chart, const cn_box *box, double corner_radius, const cn_paint *paint);
void cn_chart_circle(const cn_chart *chart, double x, double y, double radius, const cn_paint *paint);
void cn_chart_line(const cn_chart *chart, const cn_box *from_to, const cn_paint *paint); /* (x0, y0) to (x1, y1) */
void cn_chart_polyline(const cn_chart *chart, const double (*xy)[2], uint32_t n, const cn_paint *paint);
/* An SVG path about (0, 0), rotated clockwise and moved to (x, y). */
typedef struct cn_pose2 {
    double x, y, turn_deg;
} cn_pose2;
void cn_chart_path(const cn_chart *chart, const char *path, const cn_pose2 *pose, const cn_paint *paint);
/* Between the two calls, drawing is clipped to the box. */
void cn_chart_clip_begin(cn_chart *chart, const cn_box *box, double opacity);
void cn_chart_clip_end(const cn_chart *chart);

typedef enum cn_anchor { CN_ANCHOR_START = 0, CN_ANCHOR_MIDDLE, CN_ANCHOR_END } cn_anchor;
typedef struct cn_letters {
    double size;
    const char *colour; /* NULL: CN_CHART_INK */
    cn_anchor anchor;
    bool bold;
    bool halo; /* a white rim, over lines and dots */
} cn_letters;
/* One line with its baseline at y. Any text is allowed: special characters are escaped, and bytes that are not UTF-8
 * become U+FFFD. */
void cn_chart_text(const cn_chart *chart, double x, double y, const cn_letters *letters, const char *text);
/* An estimate for DejaVu Sans, on the large side. */
double cn_chart_text_width(const cn_letters *letters, const char *text);
/* Several lines. */
typedef struct cn_text_block {
    double x, y;  /* the baseline of the line above the first */
    double width; /* width of a line at most */
    double line;  /* from baseline to baseline */
    char after;   /* lines end after this character */
    uint32_t most_lines;
} cn_text_block;
/* Returns the baseline of the last line. Text that does not fit into most_lines is cut, with three dots. */
double cn_chart_wrap(const cn_chart *chart, const cn_text_block *block, const cn_letters *letters, const char *text);
#endif
