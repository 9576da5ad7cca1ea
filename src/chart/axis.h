/* Axes, and what is drawn with them: curves, limits, bars, legends. */
#ifndef CONURB_CHART_AXIS_H
#define CONURB_CHART_AXIS_H
#include "chart/chart.h"

/* Maps values to px, linearly or by logarithm. */
typedef struct cn_axis {
    double low, high;   /* values at its ends */
    double start, end;  /* px of low and of high */
    bool logarithmic;   /* values are above 0 */
    bool ends_at_ticks; /* low and high become ticks */
} cn_axis;

cn_axis cn_axis_from(double start, double end); /* no value yet; px of its ends */
void cn_axis_include(cn_axis *axis, double value);
/* Call once, after the last value. Adds a margin at both ends, a fraction of the length. An axis with one value or
 * none gets a length too. */
void cn_axis_fit(cn_axis *axis, double margin);
double cn_axis_at(const cn_axis *axis, double value); /* px; NAN for what is not finite, or not above 0 on a log axis */

/* Round values from low to high: 1, 2 and 5 times powers of ten. Returns how many. */
enum { CN_AXIS_TICKS = 32 };
uint32_t cn_axis_ticks(const cn_axis *axis, double ticks[CN_AXIS_TICKS]);
void cn_axis_print(const cn_axis *axis, double tick, char text[32]);
/* The largest 1, 2 or 5 times a power of ten up to most, which is above 0. */
double cn_round_down(double most);

/* Two axes with their titles: x below the frame, y above it. */
typedef struct cn_plot {
    cn_axis x, y;
    const char *x_title, *y_title;
} cn_plot;
cn_box cn_plot_box(const cn_plot *plot);
void cn_plot_frame(const cn_chart *chart, const cn_plot *plot);
/* A line through values, with a dot at each. */
void cn_plot_curve(const cn_chart *chart, const cn_plot *plot, const double (*xy)[2], uint32_t n, const char *colour);
/* A dashed line across, at this value of y. */
void cn_plot_limit(const cn_chart *chart, const cn_plot *plot, double y, const char *text);

/* A bar along an axis, from 0 to the value; y is its middle. */
void cn_chart_bar(const cn_chart *chart, const cn_axis *axis, double value, double y, const char *colour);

/* An entry of a legend, its text's baseline at y. Returns the x of the next one to its right. */
typedef enum cn_sign { CN_SIGN_LINE = 0, CN_SIGN_DOT, CN_SIGN_BAR } cn_sign;
typedef struct cn_legend {
    cn_sign sign;
    double radius; /* of the dot */
    cn_paint paint;
    const char *text;
} cn_legend;
double cn_chart_legend(const cn_chart *chart, double x, double y, const cn_legend *legend);
#endif
