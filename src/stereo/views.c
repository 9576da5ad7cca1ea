#include "stereo/views.h"

#include "base/units.h"
#include "image/image.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* A view needs so many sparse points, and so many in common with a source. */
enum { LEAST_POINTS = 20, LEAST_SHARED = 8 };
enum { SMALLEST = 16 }; /* width and height of a picture that can be matched, pixels */
/* Angles between rays that give depth without too much difference of look (Yao et al. 2018, "MVSNet"). Degrees. */
#define BEST_ANGLE 5.0
#define SPREAD_BELOW 2.0
#define SPREAD_ABOVE 12.0
/* Range of depths beyond those of the sparse points. */
#define NEARER 0.5f
#define FARTHER 2.0f

static cn_status no_memory(void)
{
    return cn_fail(CN_ERR_NOMEM, "out of memory for the depths of photos by stereo");
}

void cn_stereo_views_deinit(cn_stereo_views *views)
{
    for (uint32_t i = 0; views->view && i < views->n; i++) {
        free(views->view[i].grey);
        free(views->view[i].depth);
    }
    free(views->view);
    free(views->points);
    *views = (cn_stereo_views){ 0 };
}

void cn_stereo_to_camera(const cn_view *pose, const double xyz[3], double camera[3])
{
    for (int a = 0; a < 3; a++)
        camera[a] = pose->rotation[3 * a] * xyz[0] + pose->rotation[3 * a + 1] * xyz[1] +
                    pose->rotation[3 * a + 2] * xyz[2] + pose->translation[a];
}

static double at_pixel(const float *rgbw, uint32_t width, uint32_t height, double x, double y)
{
    x = fmin(fmax(x - 0.5, 0), width - 1.0);
    y = fmin(fmax(y - 0.5, 0), height - 1.0);
    const uint32_t x0 = (uint32_t)fmin(floor(x), width - 2.0), y0 = (uint32_t)fmin(floor(y), height - 2.0);
    const double u = x - x0, v = y - y0;
    double sum = 0;
    for (uint32_t i = 0; i < 4; i++) {
        const float *p = rgbw + 4 * ((size_t)(y0 + i / 2) * width + x0 + i % 2);
        const double luminance = 0.272 * (double)p[0] + 0.674 * (double)p[1] + 0.054 * (double)p[2];
        sum += (i % 2 ? u : 1 - u) * (i / 2 ? v : 1 - v) * sqrt(fmax(luminance, 0));
    }
    return sum;
}

static void make_grey(const float *small, cn_stereo_view *v)
{
    for (size_t i = 0; i < (size_t)v->width * v->height; i++) {
        const double ray[3] = { ((double)(i % v->width) + 0.5 - (double)v->cx) / (double)v->focal,
                                ((double)(i / v->width) + 0.5 - (double)v->cy) / (double)v->focal, 1 };
        double at[2];
        const bool seen = cn_camera_project(&v->camera, ray, at);
        v->grey[i] = seen ? (float)at_pixel(small, v->width, v->height, at[0], at[1]) : 0;
    }
}

/* Every so many pixels of a photo become one. */
static uint32_t step_of(uint32_t width, uint32_t width_px)
{
    return width > width_px ? (width + width_px - 1) / width_px : 1;
}

void cn_stereo_size(const cn_stereo_options *options, uint32_t width, uint32_t height, uint32_t *map_width,
                    uint32_t *map_height)
{
    const uint32_t step = step_of(width, options->width_px);
    const bool fits = width / step >= SMALLEST && height / step >= SMALLEST;
    *map_width = fits ? width / step : 0;
    *map_height = fits ? height / step : 0;
}

static cn_status read_view(const cn_stereo_input *input, const cn_stereo_options *options, cn_stereo_view *v)
{
    if (v->pose->photo >= cn_pixel_store_count(input->pixels)) return CN_OK;
    /* Windows are compared as a pinhole camera sees them, and no such camera sees all directions. */
    if (input->scene->cameras[v->pose->camera].lens == CN_LENS_EQUIRECTANGULAR) return CN_OK;
    const cn_pixel_extent extent = cn_pixel_store_extent(input->pixels, v->pose->photo);
    cn_stereo_size(options, extent.width, extent.height, &v->width, &v->height);
    if (!v->width) return CN_OK;
    cn_camera_resize(&input->scene->cameras[v->pose->camera], v->width, v->height, &v->camera);
    const bool one = v->camera.lens == CN_LENS_SIMPLE_PINHOLE || v->camera.lens == CN_LENS_SIMPLE_RADIAL ||
                     v->camera.lens == CN_LENS_RADIAL;
    v->focal = (float)v->camera.params[0];
    v->cx = (float)v->camera.params[one ? 1 : 2];
    v->cy = (float)v->camera.params[one ? 2 : 3];
    const size_t n = (size_t)v->width * v->height;
    float *rgbw = malloc(4 * sizeof *rgbw * extent.width * extent.height), *small = malloc(4 * sizeof *small * n);
    v->grey = malloc(sizeof *v->grey * n);
    cn_status status = rgbw && small && v->grey ? CN_OK : no_memory();
    if (status == CN_OK) status = cn_pixel_store_read(input->pixels, v->pose->photo, rgbw);
    if (status == CN_OK) {
        /* What a mask hides is matched too: else the mask's edge would be. */
        for (size_t i = 0; i < (size_t)extent.width * extent.height; i++)
            rgbw[4 * i + 3] = 1;
        cn_image_shrink(rgbw, extent.width, extent.height, small, v->width, v->height);
        make_grey(small, v);
    }
    free(rgbw);
    free(small);
    return status;
}

/* Lists the points of each view. row[view of the scene]: its index here, UINT32_MAX for others. */
static cn_status list_points(cn_stereo_views *views, const cn_scene *scene, const uint32_t *row)
{
    uint64_t n = 0;
    for (uint64_t i = 0; i < scene->n_observations; i++)
        n += row[scene->observations[i].view] != UINT32_MAX;
    views->points = malloc(sizeof *views->points * (n + 1));
    if (!views->points) return no_memory();
    for (uint64_t i = 0; i < scene->n_observations; i++)
        if (row[scene->observations[i].view] != UINT32_MAX) views->view[row[scene->observations[i].view]].n_points++;
    uint32_t *at = views->points;
    for (uint32_t v = 0; v < views->n; v++) {
        views->view[v].points = at;
        at += views->view[v].n_points;
        views->view[v].n_points = 0;
    }
    for (uint32_t p = 0; p < scene->n_points; p++)
        for (uint32_t k = 0; k < scene->points[p].n_observations; k++) {
            const uint32_t v = row[scene->observations[scene->points[p].first_observation + k].view];
            if (v == UINT32_MAX) continue;
            cn_stereo_view *view = &views->view[v];
            views->points[(size_t)(view->points - views->points) + view->n_points++] = p;
        }
    return CN_OK;
}

static int ascending(const void *a, const void *b)
{
    const float x = *(const float *)a, y = *(const float *)b;
    return (x > y) - (x < y);
}

static cn_status find_range(cn_stereo_view *v, const cn_scene *scene)
{
    float *depths = malloc(sizeof *depths * (v->n_points + 1u));
    if (!depths) return no_memory();
    uint32_t n = 0;
    for (uint32_t i = 0; i < v->n_points; i++) {
        double x[3];
        cn_stereo_to_camera(v->pose, scene->points[v->points[i]].xyz, x);
        if (x[2] > 0) depths[n++] = (float)x[2];
    }
    if (n < LEAST_POINTS) {
        v->width = v->height = 0;
    } else {
        qsort(depths, n, sizeof *depths, ascending);
        v->near_m = NEARER * depths[n / 100];
        v->far_m = FARTHER * depths[n - 1 - n / 100];
    }
    free(depths);
    return CN_OK;
}

/* How well two views of a point are placed for stereo: 1 at best. */
static float placed(const cn_scene *scene, const cn_point *point, uint32_t view_a, uint32_t view_b)
{
    double a[3], b[3], dot = 0, aa = 0, bb = 0;
    cn_view_centre(&scene->views[view_a], a);
    cn_view_centre(&scene->views[view_b], b);
    for (int k = 0; k < 3; k++) {
        a[k] -= point->xyz[k];
        b[k] -= point->xyz[k];
        dot += a[k] * b[k];
        aa += a[k] * a[k];
        bb += b[k] * b[k];
    }
    const double angle = cn_degrees(acos(fmin(fmax(dot / sqrt(aa * bb + 1e-30), -1), 1)));
    const double off = (angle - BEST_ANGLE) / (angle < BEST_ANGLE ? SPREAD_BELOW : SPREAD_ABOVE);
    return (float)exp(-0.5 * off * off);
}

/* score[n][n], shared[n][n]: of pairs of views. */
static void score_pairs(const cn_stereo_views *views, const cn_scene *scene, const uint32_t *row, float *score,
                        uint32_t *shared)
{
    const size_t n = views->n;
    for (uint32_t p = 0; p < scene->n_points; p++) {
        const cn_point *point = &scene->points[p];
        const cn_observation *o = scene->observations + point->first_observation;
        for (uint32_t i = 0; i < point->n_observations; i++)
            for (uint32_t j = i + 1; j < point->n_observations; j++) {
                const uint32_t a = row[o[i].view], b = row[o[j].view];
                if (a == UINT32_MAX || b == UINT32_MAX || a == b) continue;
                const float s = placed(scene, point, o[i].view, o[j].view);
                score[a * n + b] += s;
                score[b * n + a] += s;
                shared[a * n + b]++;
                shared[b * n + a]++;
            }
    }
}

static void choose_sources(cn_stereo_views *views, uint32_t v, uint32_t most, const float *score,
                           const uint32_t *shared)
{
    cn_stereo_view *view = &views->view[v];
    for (uint32_t k = 0; k < most; k++) {
        uint32_t best = views->n;
        for (uint32_t s = 0; s < views->n; s++) {
            bool out = s == v || !views->view[s].width || shared[s] < LEAST_SHARED;
            for (uint32_t i = 0; i < k && !out; i++)
                out = view->sources[i] == s;
            if (!out && (best == views->n || score[s] > score[best])) best = s;
        }
        if (best == views->n) return;
        view->sources[k] = best;
        view->n_sources = k + 1;
    }
}

static cn_status find_sources(cn_stereo_views *views, const cn_scene *scene, const uint32_t *row, uint32_t most)
{
    const size_t n = views->n;
    float *score = calloc(n * n + 1, sizeof *score);
    uint32_t *shared = calloc(n * n + 1, sizeof *shared);
    const bool room = score && shared;
    if (room) score_pairs(views, scene, row, score, shared);
    for (uint32_t v = 0; room && v < n; v++)
        choose_sources(views, v, most, score + v * n, shared + v * n);
    free(score);
    free(shared);
    return room ? CN_OK : no_memory();
}

cn_status cn_stereo_views_init(cn_stereo_views *views, const cn_stereo_input *input, const cn_stereo_options *options)
{
    const cn_scene *scene = input->scene;
    *views = (cn_stereo_views){ .view = calloc(input->n + 1u, sizeof *views->view), .n = input->n };
    uint32_t *row = malloc(sizeof *row * (scene->n_views + 1u));
    cn_status status = views->view && row ? CN_OK : no_memory();
    for (uint32_t i = 0; row && i < scene->n_views; i++)
        row[i] = UINT32_MAX;
    for (uint32_t i = 0; i < input->n && status == CN_OK; i++) {
        row[input->views[i]] = i;
        views->view[i].pose = &scene->views[input->views[i]];
        status = read_view(input, options, &views->view[i]);
    }
    if (status == CN_OK) status = list_points(views, scene, row);
    for (uint32_t i = 0; i < input->n && status == CN_OK; i++)
        status = find_range(&views->view[i], scene);
    if (status == CN_OK) status = find_sources(views, scene, row, options->sources);
    free(row);
    return status;
}
