/* The page and its shapes. */
#include "chart/chart.h"

#include "base/file.h"
#include "base/number.h"

#include <math.h>
#include <stdlib.h>

cn_status cn_chart_open(cn_chart *chart)
{
    *chart = (cn_chart){ 0 };
    chart->out = open_memstream(&chart->text, &chart->size);
    if (!chart->out) return cn_fail(CN_ERR_NOMEM, "out of memory for a chart");
    chart->before = cn_number_begin();
    return CN_OK;
}

static void print_page(const cn_chart *chart, const cn_chart_page *page, FILE *out)
{
    fprintf(out,
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"%.0f\" height=\"%.0f\" viewBox=\"0 0 %.0f %.0f\" "
            "font-family=\"DejaVu Sans, Helvetica, Arial, sans-serif\" fill=\"%s\">\n<title>%s</title>\n"
            "<rect width=\"100%%\" height=\"100%%\" fill=\"#fff\"/>\n",
            page->width, page->height, page->width, page->height, CN_CHART_INK, page->title);
    fwrite(chart->text, 1, chart->size, out);
    fputs("</svg>\n", out);
}

static bool is_whole(const cn_chart *chart)
{
    return fflush(chart->out) == 0 && !ferror(chart->out);
}

static cn_status write_page(const cn_chart *chart, const cn_chart_page *page, const char *path)
{
    cn_writer writer = { 0 };
    CN_TRY(cn_writer_open(&writer, path));
    print_page(chart, page, writer.stream);
    const cn_status status = cn_writer_commit(&writer);
    cn_writer_abort(&writer);
    return status;
}

cn_status cn_chart_save(cn_chart *chart, const cn_chart_page *page, const char *path)
{
    const cn_status status =
        is_whole(chart) ? write_page(chart, page, path) : cn_fail(CN_ERR_NOMEM, "out of memory for %s", path);
    cn_chart_discard(chart);
    return status;
}

cn_status cn_chart_print(cn_chart *chart, const cn_chart_page *page, FILE *out)
{
    const cn_status status = is_whole(chart) ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory for a chart");
    if (status == CN_OK) print_page(chart, page, out);
    cn_chart_discard(chart);
    return status;
}

void cn_chart_discard(cn_chart *chart)
{
    if (!chart->out) return;
    fclose(chart->out);
    cn_number_end(chart->before);
    free(chart->text);
    *chart = (cn_chart){ 0 };
}

bool cn_box_overlap(const cn_box *a, const cn_box *b)
{
    return a->x0 < b->x1 && b->x0 < a->x1 && a->y0 < b->y1 && b->y0 < a->y1;
}

const char *cn_chart_colour(uint32_t i)
{
    /* From Okabe and Ito's palette, darker where it was too light for text. */
    static const char *const colours[] = { "#0072b2", "#d98200", "#009e73", "#a34f8f",
                                           "#3a9bd9", "#8a7a00", "#5b5bd6", "#007a7a" };
    return colours[i % (sizeof colours / sizeof *colours)];
}

/* The attributes of a shape, and its end. */
static void close_shape(const cn_chart *chart, const cn_paint *paint)
{
    fprintf(chart->out, " fill=\"%s\"", paint->fill ? paint->fill : "none");
    if (paint->fill && paint->opacity > 0) fprintf(chart->out, " fill-opacity=\"%.2f\"", paint->opacity);
    if (paint->stroke) fprintf(chart->out, " stroke=\"%s\"", paint->stroke);
    if (paint->stroke && paint->width > 0) fprintf(chart->out, " stroke-width=\"%.1f\"", paint->width);
    if (paint->stroke && paint->dashed) fputs(" stroke-dasharray=\"6 4\"", chart->out);
    fputs("/>\n", chart->out);
}

static bool is_finite(const cn_box *box)
{
    return isfinite(box->x0) && isfinite(box->y0) && isfinite(box->x1) && isfinite(box->y1);
}

void cn_chart_rect(const cn_chart *chart, const cn_box *box, double corner_radius, const cn_paint *paint)
{
    if (!is_finite(box)) return;
    fprintf(chart->out, "<rect x=\"%.1f\" y=\"%.1f\" width=\"%.1f\" height=\"%.1f\"", box->x0, box->y0,
            box->x1 - box->x0, box->y1 - box->y0);
    if (corner_radius > 0) fprintf(chart->out, " rx=\"%.1f\"", corner_radius);
    close_shape(chart, paint);
}

void cn_chart_circle(const cn_chart *chart, double x, double y, double radius, const cn_paint *paint)
{
    if (!(isfinite(x) && isfinite(y) && isfinite(radius))) return;
    fprintf(chart->out, "<circle cx=\"%.1f\" cy=\"%.1f\" r=\"%.1f\"", x, y, radius);
    close_shape(chart, paint);
}

void cn_chart_line(const cn_chart *chart, const cn_box *from_to, const cn_paint *paint)
{
    if (!is_finite(from_to)) return;
    fprintf(chart->out, "<path d=\"M%.1f %.1fL%.1f %.1f\"", from_to->x0, from_to->y0, from_to->x1, from_to->y1);
    close_shape(chart, paint);
}

void cn_chart_polyline(const cn_chart *chart, const double (*xy)[2], uint32_t n, const cn_paint *paint)
{
    uint32_t drawn = 0;
    for (uint32_t i = 0; i < n; i++)
        if (isfinite(xy[i][0]) && isfinite(xy[i][1]))
            fprintf(chart->out, "%s%.1f %.1f", drawn++ ? "L" : "<path d=\"M", xy[i][0], xy[i][1]);
    if (drawn == 0) return;
    fputs("\" stroke-linejoin=\"round\"", chart->out);
    close_shape(chart, paint);
}

void cn_chart_path(const cn_chart *chart, const char *path, const cn_pose2 *pose, const cn_paint *paint)
{
    if (!(isfinite(pose->x) && isfinite(pose->y) && isfinite(pose->turn_deg))) return;
    fprintf(chart->out,
            "<path transform=\"translate(%.1f %.1f) rotate(%.1f)\" d=\"%s\" "
            "stroke-linejoin=\"round\"",
            pose->x, pose->y, pose->turn_deg, path);
    close_shape(chart, paint);
}

void cn_chart_clip_begin(cn_chart *chart, const cn_box *box, double opacity)
{
    const uint32_t id = chart->n_clips++;
    fprintf(chart->out,
            "<clipPath id=\"clip%u\"><rect x=\"%.1f\" y=\"%.1f\" width=\"%.1f\" height=\"%.1f\"/></clipPath>\n"
            "<g clip-path=\"url(#clip%u)\" opacity=\"%.2f\">\n",
            id, box->x0, box->y0, box->x1 - box->x0, box->y1 - box->y0, id, opacity);
}

void cn_chart_clip_end(const cn_chart *chart)
{
    fputs("</g>\n", chart->out);
}
