#include "pose/report_charts.h"

#include "chart/axis.h"

#include <math.h>
#include <stdlib.h>

#define WIDTH 860.0
#define LEFT 70.0
#define RIGHT 830.0
#define LEGEND 24.0
#define TOP 66.0
#define MOST_DRAWN 5000 /* photos; of more, every second, third and so on, so that the page stays small */

static const char CROSS[] = "M-4 -4L4 4M-4 4L4 -4", TRIANGLE[] = "M0 -7L6 5L-6 5Z", SQUARE[] = "M-5 -5H5V5H-5Z";

static uint32_t step_of(const cn_quality *q)
{
    return 1 + (q->scene->n_views ? q->scene->n_views - 1 : 0) / MOST_DRAWN;
}

uint32_t cn_report_drawn(const cn_quality *q)
{
    return (q->scene->n_views + step_of(q) - 1) / step_of(q);
}

/* ---- map ---- */

static void include(cn_plot *plot, const double at[2])
{
    cn_axis_include(&plot->x, at[0]);
    cn_axis_include(&plot->y, at[1]);
}

/* The same metres a pixel along both axes. Returns the bottom of the map. */
static double equalize(cn_plot *plot)
{
    enum { LEAST = 220, MOST = 640 };
    const double across = fmax(plot->x.high - plot->x.low, 1e-3), up = fmax(plot->y.high - plot->y.low, 1e-3);
    const double height = fmin(fmax((RIGHT - LEFT) * up / across, LEAST), MOST);
    const double metres = fmax(across / (RIGHT - LEFT), up / height);
    const double middle[2] = { 0.5 * (plot->x.low + plot->x.high), 0.5 * (plot->y.low + plot->y.high) };
    const double half[2] = { 0.55 * metres * (RIGHT - LEFT), 0.55 * metres * height };
    plot->x = (cn_axis){ .low = middle[0] - half[0], .high = middle[0] + half[0], .start = LEFT, .end = RIGHT };
    plot->y = (cn_axis){ .low = middle[1] - half[1], .high = middle[1] + half[1], .start = TOP + height, .end = TOP };
    return TOP + height;
}

static double at_x(const cn_plot *plot, double value)
{
    return cn_axis_at(&plot->x, value);
}

static double at_y(const cn_plot *plot, double value)
{
    return cn_axis_at(&plot->y, value);
}

static void draw_photos(const cn_chart *chart, const cn_plot *plot, const cn_quality *q)
{
    for (uint32_t i = 0; i < q->scene->n_views; i += step_of(q)) {
        const cn_view_quality *v = &q->views[i];
        const double x = at_x(plot, v->centre[0]), y = at_y(plot, v->centre[1]);
        const bool far = isfinite(v->off_m[0]) && !v->agrees;
        if (isfinite(v->off_m[0]))
            cn_chart_line(
                chart,
                &(cn_box){ x, y, at_x(plot, v->centre[0] - v->off_m[0]), at_y(plot, v->centre[1] - v->off_m[1]) },
                &(cn_paint){ .stroke = "#999", .width = 1 });
        cn_chart_circle(chart, x, y, 3, &(cn_paint){ .fill = cn_chart_colour(far ? 1 : 0) });
    }
    for (uint32_t i = 0; i < q->n_missing; i++)
        if (q->missing[i].has_place)
            cn_chart_path(chart, CROSS,
                          &(cn_pose2){ at_x(plot, q->missing[i].place[0]), at_y(plot, q->missing[i].place[1]), 0 },
                          &(cn_paint){ .stroke = CN_CHART_RED, .width = 2 });
}

static void draw_control(const cn_chart *chart, const cn_plot *plot, const cn_quality *q, double (*places)[3])
{
    for (uint32_t i = 0; i < q->control->n_points; i++) {
        const cn_control_point *point = &q->control->points[i];
        const cn_pose2 at = { at_x(plot, places[i][0]), at_y(plot, places[i][1]), 0 };
        cn_chart_path(chart, point->check ? SQUARE : TRIANGLE, &at,
                      &(cn_paint){ .fill = cn_chart_colour(point->check ? 3 : 2) });
        cn_chart_text(chart, at.x + 8, at.y + 4, &(cn_letters){ .size = 11, .halo = true }, point->name);
    }
}

static void draw_map_legend(const cn_chart *chart, const cn_quality *q)
{
    double x = LEFT;
    const cn_legend photo = { CN_SIGN_DOT, 3, { .fill = cn_chart_colour(0) }, "photo, with a line to its GPS" };
    const cn_legend far = { CN_SIGN_DOT, 3, { .fill = cn_chart_colour(1) }, "far from its GPS" };
    const cn_legend lost = { CN_SIGN_DOT, 3, { .fill = CN_CHART_RED }, "no pose (cross, at its GPS)" };
    const cn_legend control = { CN_SIGN_BAR, 0, { .fill = cn_chart_colour(2) }, "control point" };
    const cn_legend check = { CN_SIGN_BAR, 0, { .fill = cn_chart_colour(3) }, "check point" };
    x = cn_chart_legend(chart, x, LEGEND, &photo);
    x = cn_chart_legend(chart, x, LEGEND, &far);
    if (q->n_missing) x = cn_chart_legend(chart, x, LEGEND, &lost);
    if (q->control) x = cn_chart_legend(chart, x, LEGEND, &control);
    if (q->control) cn_chart_legend(chart, x, LEGEND, &check);
}

cn_status cn_report_draw_map(const cn_quality *q, FILE *out)
{
    cn_chart chart;
    cn_frame frame = *q->frame;
    const uint32_t n = q->control ? q->control->n_points : 0;
    cn_plot plot = { .x = cn_axis_from(0, 1), .y = cn_axis_from(0, 1) };
    double(*places)[3] = calloc(n + (size_t)1, sizeof *places);
    cn_status status = places ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory for the report");
    if (status == CN_OK && n) status = cn_control_places(q->control, &frame, places);
    if (status == CN_OK) status = cn_chart_open(&chart);
    if (status == CN_OK) {
        for (uint32_t i = 0; i < q->scene->n_views; i++)
            include(&plot, q->views[i].centre);
        for (uint32_t i = 0; i < q->n_missing; i++)
            if (q->missing[i].has_place) include(&plot, q->missing[i].place);
        for (uint32_t i = 0; i < n; i++)
            include(&plot, places[i]);
        const double bottom = equalize(&plot);
        plot.x_title = q->frame->georeferenced ? "east, m" : "x, units of the poses";
        plot.y_title = q->frame->georeferenced ? "north, m" : "y, units of the poses";
        cn_plot_frame(&chart, &plot);
        draw_photos(&chart, &plot, q);
        if (n) draw_control(&chart, &plot, q, places);
        draw_map_legend(&chart, q);
        status = cn_chart_print(&chart, &(cn_chart_page){ "Map", WIDTH, bottom + 54 }, out);
    }
    free(places);
    return status;
}

/* ---- by photo ---- */

static const char *const AXES[3] = { "east", "north", "up" };

cn_status cn_report_draw_gps(const cn_quality *q, FILE *out)
{
    cn_chart chart;
    double x = LEFT;
    cn_plot plot = { cn_axis_from(LEFT, RIGHT), cn_axis_from(300, TOP), "photo, by name", "camera minus GPS, m" };
    CN_TRY(cn_chart_open(&chart));
    cn_axis_include(&plot.x, 0);
    cn_axis_include(&plot.x, q->scene->n_views);
    cn_axis_include(&plot.y, 0);
    for (uint32_t i = 0; i < q->scene->n_views; i++)
        for (int k = 0; k < 3; k++)
            cn_axis_include(&plot.y, q->views[i].off_m[k]);
    cn_axis_fit(&plot.x, 0);
    cn_axis_fit(&plot.y, 0.05);
    cn_plot_frame(&chart, &plot);
    for (uint32_t i = 0; i < q->scene->n_views; i += step_of(q))
        for (int k = 0; k < 3; k++)
            cn_chart_circle(&chart, at_x(&plot, i + 0.5), at_y(&plot, q->views[i].off_m[k]), 2.5,
                            &(cn_paint){ .fill = cn_chart_colour((uint32_t)k) });
    for (int k = 0; k < 3; k++)
        x = cn_chart_legend(&chart, x, LEGEND,
                            &(cn_legend){ CN_SIGN_DOT, 3, { .fill = cn_chart_colour((uint32_t)k) }, AXES[k] });
    return cn_chart_print(&chart, &(cn_chart_page){ "Camera minus GPS", WIDTH, 350 }, out);
}

cn_status cn_report_draw_errors(const cn_quality *q, FILE *out)
{
    cn_chart chart;
    cn_plot plot = { cn_axis_from(LEFT, RIGHT), cn_axis_from(260, 40), "photo, by name",
                     "mean reprojection error of a photo, px" };
    CN_TRY(cn_chart_open(&chart));
    cn_axis_include(&plot.x, 0);
    cn_axis_include(&plot.x, q->scene->n_views);
    cn_axis_include(&plot.y, 0);
    for (uint32_t i = 0; i < q->scene->n_views; i++)
        cn_axis_include(&plot.y, q->views[i].error_px);
    cn_axis_fit(&plot.x, 0);
    cn_axis_fit(&plot.y, 0.05);
    cn_plot_frame(&chart, &plot);
    for (uint32_t i = 0; i < q->scene->n_views; i += step_of(q))
        cn_chart_circle(&chart, at_x(&plot, i + 0.5), at_y(&plot, q->views[i].error_px), 2.5,
                        &(cn_paint){ .fill = cn_chart_colour(0) });
    return cn_chart_print(&chart, &(cn_chart_page){ "Reprojection error by photo", WIDTH, 310 }, out);
}

cn_status cn_report_draw_histogram(const cn_quality *q, FILE *out)
{
    cn_chart chart;
    const double bin_px = CN_QUALITY_MOST_PX / CN_QUALITY_BINS;
    cn_plot plot = { cn_axis_from(LEFT, RIGHT), cn_axis_from(260, 40),
                     "reprojection error, px; the last bar has all that is larger", "sparse points in photos" };
    CN_TRY(cn_chart_open(&chart));
    cn_axis_include(&plot.x, 0);
    cn_axis_include(&plot.x, CN_QUALITY_MOST_PX);
    cn_axis_include(&plot.y, 0);
    for (int i = 0; i < CN_QUALITY_BINS; i++)
        cn_axis_include(&plot.y, (double)q->histogram[i]);
    cn_axis_fit(&plot.x, 0);
    cn_axis_fit(&plot.y, 0);
    cn_plot_frame(&chart, &plot);
    for (int i = 0; i < CN_QUALITY_BINS; i++)
        cn_chart_rect(&chart,
                      &(cn_box){ at_x(&plot, i * bin_px) + 1, at_y(&plot, (double)q->histogram[i]),
                                 at_x(&plot, (i + 1) * bin_px) - 1, at_y(&plot, 0) },
                      0, &(cn_paint){ .fill = cn_chart_colour(0) });
    return cn_chart_print(&chart, &(cn_chart_page){ "Reprojection errors", WIDTH, 310 }, out);
}
