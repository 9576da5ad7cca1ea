/* The map itself: sparse points, tiles, cameras, labels, scale bar, north arrow. */
#include "plan/svg_panel.h"

#include "base/units.h"
#include "chart/axis.h"
#include "chart/labels.h"

#include <math.h>
#include <stdlib.h>

#define MAX_WIDTH 900.0
#define MAX_HEIGHT 780.0
#define MIN_SIDE 460.0
#define MARGIN 64.0 /* room for labels around the tiles */
#define MAX_POINTS 8000u
#define MAX_CAMERAS 5000u
#define MAX_LABELS 300u

static void grow(cn_box *b, double x, double y, double by)
{
    b->x0 = fmin(b->x0, x - by);
    b->y0 = fmin(b->y0, y - by);
    b->x1 = fmax(b->x1, x + by);
    b->y1 = fmax(b->y1, y + by);
}

static double to_x(const cn_svg_map *m, double east)
{
    return m->box.x0 + (east - m->west_m) * m->px_per_m;
}
static double to_y(const cn_svg_map *m, double north)
{
    return m->box.y0 + (m->north_m - north) * m->px_per_m;
}

/* Scale and corner so that tiles and cameras fill the map. */
static void fit(cn_svg_map *m)
{
    cn_box b = { INFINITY, INFINITY, -INFINITY, -INFINITY };
    const cn_scene *scene = m->input->scene;
    for (uint32_t i = 0; i < m->plan->n_tiles; i++)
        grow(&b, m->plan->tiles[i].centre[0], m->plan->tiles[i].centre[1], m->plan->tiles[i].radius_m);
    for (uint32_t i = 0; i < scene->n_views; i++) {
        double c[3];
        cn_view_centre(&scene->views[i], c);
        grow(&b, c[0], c[1], 0);
    }
    const double w = fmax(b.x1 - b.x0, 1e-9), h = fmax(b.y1 - b.y0, 1e-9);
    m->px_per_m = fmin((MAX_WIDTH - 2 * MARGIN) / w, (MAX_HEIGHT - 2 * MARGIN) / h);
    const double width = fmax(w * m->px_per_m + 2 * MARGIN, MIN_SIDE);
    const double height = fmax(h * m->px_per_m + 2 * MARGIN, MIN_SIDE);
    m->west_m = (b.x0 + b.x1) / 2 - width / 2 / m->px_per_m;
    m->north_m = (b.y0 + b.y1) / 2 + height / 2 / m->px_per_m;
    m->box = (cn_box){ CN_SVG_MAP_LEFT, CN_SVG_MAP_TOP, CN_SVG_MAP_LEFT + width, CN_SVG_MAP_TOP + height };
}

static void draw_points(cn_svg_map *m)
{
    const cn_scene *scene = m->input->scene;
    uint32_t stride = scene->n_points / MAX_POINTS + 1;
    cn_chart_clip_begin(&m->chart, &m->box, 0.6);
    for (uint32_t i = 0; i < scene->n_points; i += stride) {
        const cn_point *p = &scene->points[i];
        const double x = to_x(m, p->xyz[0]), y = to_y(m, p->xyz[1]);
        char colour[8];
        if (!(x > m->box.x0 && x < m->box.x1 && y > m->box.y0 && y < m->box.y1)) continue;
        snprintf(colour, sizeof colour, "#%02x%02x%02x", p->rgb[0], p->rgb[1], p->rgb[2]);
        cn_chart_circle(&m->chart, x, y, 1.3, &(cn_paint){ .fill = colour });
    }
    cn_chart_clip_end(&m->chart);
}

static void draw_tiles(const cn_svg_map *m)
{
    for (uint32_t i = 0; i < m->plan->n_tiles; i++) {
        const cn_plan_tile *t = &m->plan->tiles[i];
        const double x = to_x(m, t->centre[0]), y = to_y(m, t->centre[1]);
        const cn_paint disc = cn_svg_tile_paint(i, 0.13), cross = { .stroke = cn_chart_colour(i), .width = 2 };
        cn_chart_circle(&m->chart, x, y, t->radius_m * m->px_per_m, &disc);
        cn_chart_path(&m->chart, "M-6 0h12m-6 -6v12", &(cn_pose2){ x, y, 0 }, &cross);
    }
}

static void draw_cameras(const cn_svg_map *m)
{
    const cn_scene *scene = m->input->scene;
    uint32_t stride = scene->n_views / MAX_CAMERAS + 1;
    for (uint32_t i = 0; i < scene->n_views; i += stride) {
        const double *r = scene->views[i].rotation;
        double c[3];
        const bool down = fabs(r[8]) > 0.85;
        const double sign = down ? -1 : 1, *axis = down ? r + 3 : r + 6; /* the photo's up, or forward */
        cn_view_centre(&scene->views[i], c);
        cn_svg_camera(&m->chart,
                      &(cn_camera_sign){
                          .pose = { to_x(m, c[0]), to_y(m, c[1]), cn_degrees(atan2(sign * axis[0], sign * axis[1])) },
                          .down = down,
                          .held = m->held[i],
                          .colour = m->home[i] == UINT32_MAX ? CN_CHART_GREY : cn_chart_colour(m->home[i]),
                      });
    }
}

/* A name beside each tile, but where all places around its rim are taken: the legend still has it. */
static void draw_labels(const cn_svg_map *m, cn_labels *labels)
{
    double middle[2] = { 0, 0 };
    for (uint32_t i = 0; i < m->plan->n_tiles; i++)
        for (int k = 0; k < 2; k++)
            middle[k] += m->plan->tiles[i].centre[k] / m->plan->n_tiles;
    for (uint32_t i = 0; i < m->plan->n_tiles && labels->n < MAX_LABELS; i++) {
        const cn_plan_tile *t = &m->plan->tiles[i];
        const cn_letters letters = { .size = 15, .bold = true, .halo = true, .colour = cn_chart_colour(i) };
        const cn_labelled tile = {
            .x = to_x(m, t->centre[0]),
            .y = to_y(m, t->centre[1]),
            .radius = t->radius_m * m->px_per_m,
            .towards = m->plan->n_tiles > 1 ? atan2(t->centre[1] - middle[1], t->centre[0] - middle[0]) : CN_PI / 2,
            .rings = 1,
        };
        cn_box box;
        if (cn_labels_place(labels, &tile, &letters, t->id, &box) > 0) continue;
        cn_labels_avoid(labels, &box, 1);
        cn_labels_draw(&m->chart, &box, &letters, t->id);
    }
}

/* ---- scale bar and north arrow ---- */

static cn_box draw_scale(const cn_svg_map *m)
{
    const double metres = cn_round_down(0.25 * (m->box.x1 - m->box.x0) / m->px_per_m), length = metres * m->px_per_m;
    const double x = m->box.x0 + 16, y = m->box.y1 - 16;
    const cn_box b = { x - 8, y - 28, x + length + 8, y + 10 };
    char text[48], bar[48];
    snprintf(text, sizeof text, "%g %s", metres, cn_frame_unit(m->input->frame));
    snprintf(bar, sizeof bar, "M0 0v8h%.1fv-8", length);
    cn_chart_rect(&m->chart, &b, 4, &(cn_paint){ .fill = "#fff", .opacity = 0.8 });
    cn_chart_path(&m->chart, bar, &(cn_pose2){ x, y - 5, 0 }, &(cn_paint){ .stroke = CN_CHART_INK, .width = 2 });
    cn_chart_text(&m->chart, x + length / 2, y - 6, &(cn_letters){ .size = 14, .anchor = CN_ANCHOR_MIDDLE }, text);
    return b;
}

static cn_box draw_north(const cn_svg_map *m)
{
    const double x = m->box.x1 - 28, y = m->box.y0 + 20;
    cn_chart_path(&m->chart, "M0 0l9 28l-9 -7l-9 7z", &(cn_pose2){ x, y, 0 }, &(cn_paint){ .fill = CN_CHART_INK });
    cn_chart_text(&m->chart, x, y + 45, &(cn_letters){ .size = 15, .bold = true, .anchor = CN_ANCHOR_MIDDLE },
                  m->input->frame->georeferenced ? "N" : "+y");
    return (cn_box){ x - 16, y - 6, x + 16, y + 50 };
}

static void draw_map(cn_svg_map *m)
{
    cn_labels labels = { .area = m->box };
    cn_chart_rect(&m->chart, &m->box, 0, &(cn_paint){ .fill = "#f6f5f1", .stroke = "#bbb" });
    draw_points(m);
    draw_tiles(m);
    draw_cameras(m);
    const cn_box scale = draw_scale(m), north = draw_north(m);
    cn_labels_avoid(&labels, &scale, 1);
    cn_labels_avoid(&labels, &north, 1);
    draw_labels(m, &labels);
}

/* ---- */

static double squared(const double a[3], const double b[3])
{
    const double x = a[0] - b[0], y = a[1] - b[1];
    return x * x + y * y;
}

/* The nearest of each view's tiles, and which views are held out. */
static void find_homes(cn_svg_map *m, uint32_t *home, bool *held)
{
    const cn_scene *scene = m->input->scene;
    for (uint32_t v = 0; v < scene->n_views; v++)
        home[v] = UINT32_MAX;
    for (uint32_t i = 0; i < m->plan->n_tiles; i++) {
        const cn_plan_tile *t = &m->plan->tiles[i];
        for (uint32_t k = 0; k < t->n_photos + t->n_held_out; k++) {
            uint32_t v = k < t->n_photos ? t->photos[k] : t->held_out[k - t->n_photos];
            double c[3];
            cn_view_centre(&scene->views[v], c);
            const double *old = home[v] == UINT32_MAX ? NULL : m->plan->tiles[home[v]].centre;
            if (!old || squared(c, t->centre) < squared(c, old)) home[v] = i;
            if (k >= t->n_photos && !held[v]) {
                held[v] = true;
                m->n_held_out++;
            }
        }
    }
    m->home = home;
    m->held = held;
}

static cn_status draw(cn_svg_map *m, const char *path)
{
    CN_TRY(cn_chart_open(&m->chart));
    fit(m);
    draw_map(m);
    const double lowest = cn_svg_panel(m);
    const cn_chart_page page = { .title = "Conurb plan",
                                 .width = m->box.x1 + CN_SVG_PANEL_WIDTH,
                                 .height = fmax(m->box.y1, lowest) + 24 };
    return cn_chart_save(&m->chart, &page, path);
}

cn_status cn_plan_write_svg(const cn_plan *plan, const cn_plan_input *input, const char *path)
{
    cn_svg_map map = { .plan = plan, .input = input };
    uint32_t *home = malloc(sizeof *home * (input->scene->n_views + 1));
    bool *held = calloc(input->scene->n_views + 1, sizeof *held);
    cn_status status = CN_OK;
    if (home && held) {
        find_homes(&map, home, held);
        status = draw(&map, path);
    } else
        status = cn_fail(CN_ERR_NOMEM, "out of memory writing %s", path);
    free(home);
    free(held);
    return status;
}
