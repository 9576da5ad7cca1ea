/* The map itself: sparse points, tiles, cameras, labels, scale bar, north arrow. */
#include "plan/svg_panel.h"

#include "base/file.h"
#include "base/number.h"
#include "base/units.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define MAX_WIDTH 900.0
#define MAX_HEIGHT 780.0
#define MIN_SIDE 460.0
#define MARGIN 64.0 /* room for labels around the tiles */
#define MAX_POINTS 8000u
#define MAX_CAMERAS 5000u
#define MAX_LABELS 300u

typedef struct box {
    double x0, y0, x1, y1;
} box;

static void grow(box *b, double x, double y, double by)
{
    b->x0 = fmin(b->x0, x - by);
    b->y0 = fmin(b->y0, y - by);
    b->x1 = fmax(b->x1, x + by);
    b->y1 = fmax(b->y1, y + by);
}

static double to_x(const cn_svg_map *m, double east)
{
    return CN_SVG_MAP_LEFT + (east - m->west_m) * m->px_per_m;
}
static double to_y(const cn_svg_map *m, double north)
{
    return CN_SVG_MAP_TOP + (m->north_m - north) * m->px_per_m;
}

/* Scale and corner so that tiles and cameras fill the map. */
static void fit(cn_svg_map *m)
{
    box b = { INFINITY, INFINITY, -INFINITY, -INFINITY };
    const cn_scene *scene = m->input->scene;
    for (uint32_t i = 0; i < m->plan->n_tiles; i++)
        grow(&b, m->plan->tiles[i].centre[0], m->plan->tiles[i].centre[1], m->plan->tiles[i].radius_m);
    for (uint32_t i = 0; i < scene->n_views; i++) {
        double c[3];
        cn_view_centre(&scene->views[i], c);
        grow(&b, c[0], c[1], 0);
    }
    double w = fmax(b.x1 - b.x0, 1e-9), h = fmax(b.y1 - b.y0, 1e-9);
    m->px_per_m = fmin((MAX_WIDTH - 2 * MARGIN) / w, (MAX_HEIGHT - 2 * MARGIN) / h);
    m->width = fmax(w * m->px_per_m + 2 * MARGIN, MIN_SIDE);
    m->height = fmax(h * m->px_per_m + 2 * MARGIN, MIN_SIDE);
    m->west_m = (b.x0 + b.x1) / 2 - m->width / 2 / m->px_per_m;
    m->north_m = (b.y0 + b.y1) / 2 + m->height / 2 / m->px_per_m;
}

static void draw_points(const cn_svg_map *m)
{
    const cn_scene *scene = m->input->scene;
    uint32_t stride = scene->n_points / MAX_POINTS + 1;
    fputs("<g clip-path=\"url(#map)\" opacity=\"0.6\">\n", m->out);
    for (uint32_t i = 0; i < scene->n_points; i += stride) {
        const cn_point *p = &scene->points[i];
        double x = to_x(m, p->xyz[0]), y = to_y(m, p->xyz[1]);
        if (!(x > CN_SVG_MAP_LEFT && x < CN_SVG_MAP_LEFT + m->width && y > CN_SVG_MAP_TOP &&
              y < CN_SVG_MAP_TOP + m->height))
            continue;
        fprintf(m->out, "<circle cx=\"%.1f\" cy=\"%.1f\" r=\"1.3\" fill=\"#%02x%02x%02x\"/>\n", x, y, p->rgb[0],
                p->rgb[1], p->rgb[2]);
    }
    fputs("</g>\n", m->out);
}

static void draw_tiles(const cn_svg_map *m)
{
    for (uint32_t i = 0; i < m->plan->n_tiles; i++) {
        const cn_plan_tile *t = &m->plan->tiles[i];
        double x = to_x(m, t->centre[0]), y = to_y(m, t->centre[1]);
        fprintf(m->out,
                "<circle cx=\"%.1f\" cy=\"%.1f\" r=\"%.1f\" fill=\"%s\" fill-opacity=\"0.13\" stroke=\"%s\" "
                "stroke-width=\"2\"/>\n",
                x, y, t->radius_m * m->px_per_m, cn_svg_colour(i), cn_svg_colour(i));
        fprintf(m->out, "<path d=\"M%.1f %.1fh12m-6 -6v12\" stroke=\"%s\" stroke-width=\"2\" fill=\"none\"/>\n", x - 6,
                y, cn_svg_colour(i));
    }
}

static void draw_cameras(const cn_svg_map *m)
{
    const cn_scene *scene = m->input->scene;
    uint32_t stride = scene->n_views / MAX_CAMERAS + 1;
    for (uint32_t i = 0; i < scene->n_views; i += stride) {
        const double *r = scene->views[i].rotation;
        double c[3];
        bool down = fabs(r[8]) > 0.85;
        const double sign = down ? -1 : 1, *axis = down ? r + 3 : r + 6; /* the photo's up, or forward */
        cn_view_centre(&scene->views[i], c);
        cn_svg_camera(m->out, to_x(m, c[0]), to_y(m, c[1]), cn_degrees(atan2(sign * axis[0], sign * axis[1])), down,
                      m->home[i] == UINT32_MAX ? "#666" : cn_svg_colour(m->home[i]), m->held[i]);
    }
}

/* ---- labels ---- */

static bool apart(const box *a, const box *b)
{
    return a->x1 < b->x0 || b->x1 < a->x0 || a->y1 < b->y0 || b->y1 < a->y0;
}

/* Tries places around the tile's rim, outermost first; false when all are taken. */
static bool place_label(const cn_svg_map *m, uint32_t tile, double outward, const box *taken, uint32_t n_taken,
                        box *label)
{
    static const int turns[] = { 0, 1, -1, 2, -2, 3, -3, 4, -4, 5, -5, 6, -6, 7, -7, 8 };
    const cn_plan_tile *t = &m->plan->tiles[tile];
    double half_w = 0.31 * 15 * (double)strlen(t->id) + 5, half_h = 11, radius = t->radius_m * m->px_per_m;
    for (size_t i = 0; i < sizeof turns / sizeof *turns; i++) {
        double angle = outward + turns[i] * CN_PI / 8, ux = cos(angle), uy = -sin(angle);
        double reach = radius + 4 + fabs(ux) * half_w + fabs(uy) * half_h;
        double x = to_x(m, t->centre[0]) + ux * reach, y = to_y(m, t->centre[1]) + uy * reach;
        *label = (box){ x - half_w, y - half_h, x + half_w, y + half_h };
        bool fits = label->x0 > CN_SVG_MAP_LEFT && label->x1 < CN_SVG_MAP_LEFT + m->width &&
                    label->y0 > CN_SVG_MAP_TOP && label->y1 < CN_SVG_MAP_TOP + m->height;
        for (uint32_t k = 0; k < n_taken && fits; k++)
            fits = apart(label, &taken[k]);
        if (fits) return true;
    }
    return false;
}

static void draw_labels(const cn_svg_map *m, const box *reserved, uint32_t n_reserved)
{
    box taken[MAX_LABELS + 4];
    uint32_t n_taken = 0;
    double middle[2] = { 0, 0 };
    for (; n_taken < n_reserved; n_taken++)
        taken[n_taken] = reserved[n_taken];
    for (uint32_t i = 0; i < m->plan->n_tiles; i++)
        for (int k = 0; k < 2; k++)
            middle[k] += m->plan->tiles[i].centre[k] / m->plan->n_tiles;
    for (uint32_t i = 0; i < m->plan->n_tiles && n_taken < MAX_LABELS; i++) {
        const double *c = m->plan->tiles[i].centre;
        double outward = m->plan->n_tiles > 1 ? atan2(c[1] - middle[1], c[0] - middle[0]) : CN_PI / 2;
        box *label = &taken[n_taken];
        if (!place_label(m, i, outward, taken, n_taken, label)) continue; /* the legend still has it */
        n_taken++;
        char style[160];
        snprintf(style, sizeof style,
                 "font-size=\"15\" font-weight=\"bold\" text-anchor=\"middle\" fill=\"%s\" stroke=\"#fff\" "
                 "stroke-width=\"4\" paint-order=\"stroke\"",
                 cn_svg_colour(i));
        cn_svg_text(m->out, (label->x0 + label->x1) / 2, label->y1 - 6, style, m->plan->tiles[i].id);
    }
}

/* ---- scale bar and north arrow ---- */

/* Largest 1, 2 or 5 times a power of ten up to v. */
static double round_down(double v)
{
    double power = pow(10, floor(log10(v))), part = v / power;
    return power * (part >= 5 ? 5 : part >= 2 ? 2 : 1);
}

static box draw_scale(const cn_svg_map *m)
{
    double metres = round_down(0.25 * m->width / m->px_per_m), length = metres * m->px_per_m;
    double x = CN_SVG_MAP_LEFT + 16, y = CN_SVG_MAP_TOP + m->height - 16;
    box b = { x - 8, y - 28, x + length + 8, y + 10 };
    char text[48];
    snprintf(text, sizeof text, "%g %s", metres, cn_frame_unit(m->input->frame));
    fprintf(
        m->out,
        "<rect x=\"%.1f\" y=\"%.1f\" width=\"%.1f\" height=\"%.1f\" rx=\"4\" fill=\"#fff\" fill-opacity=\"0.8\"/>\n",
        b.x0, b.y0, b.x1 - b.x0, b.y1 - b.y0);
    fprintf(m->out, "<path d=\"M%.1f %.1fv8h%.1fv-8\" stroke=\"#222\" stroke-width=\"2\" fill=\"none\"/>\n", x, y - 5,
            length);
    cn_svg_text(m->out, x + length / 2, y - 6, "font-size=\"14\" text-anchor=\"middle\"", text);
    return b;
}

static box draw_north(const cn_svg_map *m)
{
    double x = CN_SVG_MAP_LEFT + m->width - 28, y = CN_SVG_MAP_TOP + 20;
    fprintf(m->out, "<path d=\"M%.1f %.1fl9 28l-9 -7l-9 7z\" fill=\"#222\"/>\n", x, y);
    cn_svg_text(m->out, x, y + 45, "font-size=\"15\" font-weight=\"bold\" text-anchor=\"middle\"",
                m->input->frame->georeferenced ? "N" : "+y");
    return (box){ x - 16, y - 6, x + 16, y + 50 };
}

static void draw_map(const cn_svg_map *m)
{
    box reserved[2];
    fprintf(m->out,
            "<rect width=\"100%%\" height=\"100%%\" fill=\"#fff\"/>\n<clipPath id=\"map\"><rect x=\"%.1f\" y=\"%.1f\" "
            "width=\"%.1f\" height=\"%.1f\"/></clipPath>\n",
            CN_SVG_MAP_LEFT, CN_SVG_MAP_TOP, m->width, m->height);
    fprintf(m->out, "<rect x=\"%.1f\" y=\"%.1f\" width=\"%.1f\" height=\"%.1f\" fill=\"#f6f5f1\" stroke=\"#bbb\"/>\n",
            CN_SVG_MAP_LEFT, CN_SVG_MAP_TOP, m->width, m->height);
    draw_points(m);
    draw_tiles(m);
    draw_cameras(m);
    reserved[0] = draw_scale(m);
    reserved[1] = draw_north(m);
    draw_labels(m, reserved, 2);
}

/* The words come first, into memory: the page is as high as they need. */
static cn_status draw(const cn_svg_map *m, const char *path)
{
    cn_svg_map words = *m;
    char *text = NULL;
    size_t size = 0;
    words.out = open_memstream(&text, &size);
    if (!words.out) return cn_fail(CN_ERR_NOMEM, "out of memory writing %s", path);
    const double lowest = cn_svg_panel(&words);
    if (fclose(words.out) != 0) {
        free(text);
        return cn_fail(CN_ERR_NOMEM, "out of memory writing %s", path);
    }
    const double height = fmax(CN_SVG_MAP_TOP + m->height, lowest) + 24;
    const double width = CN_SVG_MAP_LEFT + m->width + CN_SVG_PANEL_WIDTH;
    fprintf(m->out,
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"%.0f\" height=\"%.0f\" viewBox=\"0 0 %.0f %.0f\" "
            "font-family=\"DejaVu Sans, Helvetica, Arial, sans-serif\" fill=\"#222\">\n<title>Conurb plan</title>\n",
            width, height, width, height);
    draw_map(m);
    fwrite(text, 1, size, m->out);
    fputs("</svg>\n", m->out);
    free(text);
    return CN_OK;
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

cn_status cn_plan_write_svg(const cn_plan *plan, const cn_plan_input *input, const char *path)
{
    cn_svg_map map = { .plan = plan, .input = input };
    cn_writer writer = { 0 };
    uint32_t *home = malloc(sizeof *home * (input->scene->n_views + 1));
    bool *held = calloc(input->scene->n_views + 1, sizeof *held);
    cn_status status =
        home && held ? cn_writer_open(&writer, path) : cn_fail(CN_ERR_NOMEM, "out of memory writing %s", path);
    if (status == CN_OK) {
        map.out = writer.stream;
        find_homes(&map, home, held);
        fit(&map);
        const locale_t before = cn_number_begin();
        status = draw(&map, path);
        cn_number_end(before);
    }
    if (status == CN_OK) status = cn_writer_commit(&writer);
    cn_writer_abort(&writer);
    free(home);
    free(held);
    return status;
}
