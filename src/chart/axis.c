#include "chart/axis.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define MOST_STEPS 7.0  /* of a linear axis */
#define MOST_DECADES 10 /* that a logarithmic axis marks one by one */
#define BAR_HEIGHT 14.0

double cn_round_down(double most)
{
    const double power = pow(10, floor(log10(most) + 1e-9)), part = most / power * (1 + 1e-9);
    return power * (part >= 5 ? 5 : part >= 2 ? 2 : 1);
}

/* ---- range ---- */

static bool fits_axis(const cn_axis *axis, double value)
{
    return isfinite(value) && (value > 0 || !axis->logarithmic);
}

cn_axis cn_axis_from(double start, double end)
{
    return (cn_axis){ .low = INFINITY, .high = -INFINITY, .start = start, .end = end };
}

void cn_axis_include(cn_axis *axis, double value)
{
    if (!fits_axis(axis, value)) return;
    axis->low = fmin(axis->low, value);
    axis->high = fmax(axis->high, value);
}

/* The distance of a linear axis's ticks. */
static double step_of(double low, double high)
{
    const double least = (high - low) / MOST_STEPS, power = pow(10, floor(log10(least)));
    const double part = least / power * (1 - 1e-9);
    return power * (part <= 1 ? 1 : part <= 2 ? 2 : part <= 5 ? 5 : 10);
}

static void fit_linear(cn_axis *a, double margin)
{
    const double length = a->high - a->low;
    if (!(length > 1e-9 * fabs(a->high))) {
        const double half = a->low == 0 ? 0.5 : 0.05 * fabs(a->low);
        a->low -= half, a->high += half;
    } else
        a->low -= margin * length, a->high += margin * length;
    /* A longer axis may have coarser ticks. */
    for (double step = 0; a->ends_at_ticks && step < step_of(a->low, a->high);) {
        step = step_of(a->low, a->high);
        a->low = step * floor(a->low / step + 1e-6), a->high = step * ceil(a->high / step - 1e-6);
    }
}

void cn_axis_fit(cn_axis *axis, double margin)
{
    if (!(axis->low <= axis->high)) axis->low = axis->high = axis->logarithmic ? 1 : 0;
    if (!axis->logarithmic) {
        fit_linear(axis, margin);
        return;
    }
    double low = log10(axis->low), high = log10(axis->high);
    const double room = high - low > 1e-6 ? margin * (high - low) : 0.1;
    low -= room, high += room;
    if (axis->ends_at_ticks) low = floor(low + 1e-9), high = ceil(high - 1e-9);
    axis->low = pow(10, low), axis->high = pow(10, high);
}

double cn_axis_at(const cn_axis *axis, double value)
{
    if (!fits_axis(axis, value)) return NAN;
    const double share = axis->logarithmic ? log(value / axis->low) / log(axis->high / axis->low)
                                           : (value - axis->low) / (axis->high - axis->low);
    return axis->start + share * (axis->end - axis->start);
}

/* ---- ticks ---- */

static uint32_t linear_ticks(const cn_axis *a, double ticks[CN_AXIS_TICKS])
{
    const double step = step_of(a->low, a->high), first = ceil(a->low / step - 1e-6);
    uint32_t n = 0;
    for (; n < CN_AXIS_TICKS && (first + n) * step <= a->high + 1e-6 * step; n++)
        ticks[n] = (first + n) * step;
    return n;
}

uint32_t cn_axis_ticks(const cn_axis *axis, double ticks[CN_AXIS_TICKS])
{
    if (!axis->logarithmic) return linear_ticks(axis, ticks);
    const double low = log10(axis->low) - 1e-9, high = log10(axis->high) + 1e-9, span = high - low;
    const int every = span > MOST_DECADES ? (int)ceil(span / MOST_DECADES) : 1;
    uint32_t n = 0;
    for (int decade = (int)floor(low); decade <= high; decade += every)
        for (int k = 1; k < 10; k += k == 1 ? 1 : k == 2 ? 3 : 5) {
            const double at = decade + log10(k);
            if (at >= low && at <= high && n < CN_AXIS_TICKS && (k == 1 || span < 2.5))
                ticks[n++] = k * pow(10, decade);
        }
    return n >= 2 ? n : linear_ticks(axis, ticks);
}

void cn_axis_print(const cn_axis *axis, double tick, char text[32])
{
    static const char *const raised[] = { "\u2070", "\u00b9", "\u00b2", "\u00b3", "\u2074",
                                          "\u2075", "\u2076", "\u2077", "\u2078", "\u2079" };
    const double power = tick > 0 ? log10(tick) : NAN;
    if (!axis->logarithmic || !(fabs(power) > 4.5) || fabs(power - round(power)) > 1e-6) {
        snprintf(text, 32, "%g", tick + 0.0);
        return;
    }
    char digits[8];
    snprintf(digits, sizeof digits, "%d", abs((int)round(power)) % 1000);
    snprintf(text, 32, "10%s", power < 0 ? "\u207b" : "");
    for (const char *c = digits; *c; c++)
        strcat(text, raised[*c - '0']);
}

/* ---- plots ---- */

cn_box cn_plot_box(const cn_plot *plot)
{
    return (cn_box){ plot->x.start, plot->y.end, plot->x.end, plot->y.start };
}

void cn_plot_frame(const cn_chart *chart, const cn_plot *plot)
{
    const cn_box box = cn_plot_box(plot);
    const cn_paint grid = { .stroke = "#e4e4e4" };
    const cn_letters below = { .size = 12, .colour = "#444", .anchor = CN_ANCHOR_MIDDLE };
    const cn_letters beside = { .size = 12, .colour = "#444", .anchor = CN_ANCHOR_END };
    double ticks[CN_AXIS_TICKS];
    char text[32];
    uint32_t n = cn_axis_ticks(&plot->y, ticks);
    for (uint32_t i = 0; i < n; i++) {
        const double y = cn_axis_at(&plot->y, ticks[i]);
        cn_axis_print(&plot->y, ticks[i], text);
        cn_chart_line(chart, &(cn_box){ box.x0, y, box.x1, y }, &grid);
        cn_chart_text(chart, box.x0 - 6, y + 4, &beside, text);
    }
    n = cn_axis_ticks(&plot->x, ticks);
    for (uint32_t i = 0; i < n; i++) {
        const double x = cn_axis_at(&plot->x, ticks[i]);
        cn_axis_print(&plot->x, ticks[i], text);
        cn_chart_line(chart, &(cn_box){ x, box.y0, x, box.y1 }, &grid);
        cn_chart_text(chart, x, box.y1 + 18, &below, text);
    }
    cn_chart_rect(chart, &box, 0, &(cn_paint){ .stroke = "#999" });
    cn_chart_text(chart, box.x0, box.y0 - 14, &(cn_letters){ .size = 14, .bold = true }, plot->y_title);
    cn_chart_text(chart, (box.x0 + box.x1) / 2, box.y1 + 38, &(cn_letters){ .size = 13, .anchor = CN_ANCHOR_MIDDLE },
                  plot->x_title);
}

void cn_plot_curve(const cn_chart *chart, const cn_plot *plot, const double (*xy)[2], uint32_t n, const char *colour)
{
    const cn_paint line = { .stroke = colour, .width = 2 }, dot = { .fill = colour };
    double last[2] = { NAN, NAN };
    for (uint32_t i = 0; i < n; i++) {
        const double at[2] = { cn_axis_at(&plot->x, xy[i][0]), cn_axis_at(&plot->y, xy[i][1]) };
        if (!isfinite(at[0]) || !isfinite(at[1])) continue;
        cn_chart_line(chart, &(cn_box){ last[0], last[1], at[0], at[1] }, &line);
        cn_chart_circle(chart, at[0], at[1], 3, &dot);
        memcpy(last, at, sizeof last);
    }
}

void cn_plot_limit(const cn_chart *chart, const cn_plot *plot, double y, const char *text)
{
    const double at = cn_axis_at(&plot->y, y);
    cn_chart_line(chart, &(cn_box){ plot->x.start, at, plot->x.end, at },
                  &(cn_paint){ .stroke = CN_CHART_RED, .dashed = true });
    cn_chart_text(chart, plot->x.start + 6, at - 5, &(cn_letters){ .size = 12, .colour = CN_CHART_RED }, text);
}

void cn_chart_bar(const cn_chart *chart, const cn_axis *axis, double value, double y, const char *colour)
{
    const double zero = cn_axis_at(axis, 0), at = cn_axis_at(axis, value);
    cn_chart_rect(chart,
                  &(cn_box){ value < 0 ? at : zero, y - BAR_HEIGHT / 2, value < 0 ? zero : at, y + BAR_HEIGHT / 2 }, 0,
                  &(cn_paint){ .fill = colour });
}

double cn_chart_legend(const cn_chart *chart, double x, double y, const cn_legend *legend)
{
    const cn_letters letters = { .size = 12 };
    const double middle = y - 4;
    double width = 28;
    if (legend->sign == CN_SIGN_LINE)
        cn_chart_line(chart, &(cn_box){ x, middle, x + width, middle }, &legend->paint);
    else if (legend->sign == CN_SIGN_DOT) {
        width = 2 * legend->radius;
        cn_chart_circle(chart, x + legend->radius, middle, legend->radius, &legend->paint);
    } else {
        width = 12;
        cn_chart_rect(chart, &(cn_box){ x, middle - 6, x + width, middle + 6 }, 0, &legend->paint);
    }
    cn_chart_text(chart, x + width + 7, y, &letters, legend->text);
    return x + width + 7 + cn_chart_text_width(&letters, legend->text) + 20;
}
