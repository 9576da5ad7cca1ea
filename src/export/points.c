/* Coloured points, from depth maps of the photos' views. */
#include "base/clock.h"
#include "export/cubes.h"
#include "export/height_sampler.h"
#include "export/point_file.h"
#include "math/linalg.h"
#include "math/plane.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define MIN_ALPHA 0.9f
#define MAX_BEND 0.02f /* fraction of the depth by which a pixel may differ from the mean of its neighbours */

typedef struct cloud {
    cn_height_sampler sampler;
    cn_cubes cubes;
    cn_point_file file;
    cn_picture picture;
    float *display;
    double spacing_m, gsd_m;
    uint32_t views_done, views_all;
    double started;
} cloud;

/* Depth is not sure at edges, between foreground and background: leave out pixels where it bends. The sky is opaque and
 * has none. */
static bool smooth_at(const cn_picture *p, uint32_t x, uint32_t y)
{
    const size_t at = (size_t)y * p->width + x;
    const float d = p->depth[at];
    const size_t steps[2] = { 1, p->width };
    if (!(d > 0)) return false;
    for (int k = 0; k < 2; k++) {
        if (p->rgba[4 * (at - steps[k]) + 3] < MIN_ALPHA || p->rgba[4 * (at + steps[k]) + 3] < MIN_ALPHA) return false;
        if (fabsf(p->depth[at - steps[k]] + p->depth[at + steps[k]] - 2 * d) > MAX_BEND * d) return false;
    }
    return true;
}

/* Where the picture was taken from. */
typedef struct station {
    const cn_camera *camera;
    const cn_view *view;
    double eye[3];
} station;

static bool lift_pixel(const cloud *c, const station *from, uint32_t x, uint32_t y, double xyz[3])
{
    const cn_height_sampler *s = &c->sampler;
    const size_t at = (size_t)y * from->camera->width + x;
    double dir[3], away[3];
    if (c->picture.rgba[4 * at + 3] < MIN_ALPHA || !smooth_at(&c->picture, x, y)) return false;
    if (cn_camera_unproject(from->camera, x + 0.5, y + 0.5, dir) != CN_OK) return false;
    cn_mat3_tvec(from->view->rotation, dir, away);
    for (int k = 0; k < 3; k++)
        xyz[k] = from->eye[k] + c->picture.depth[at] * away[k];
    const double off = hypot(xyz[0] - s->place->centre[0], xyz[1] - s->place->centre[1]);
    return off < s->survey->reach * s->place->radius_m && xyz[2] > s->bottom_m && xyz[2] < s->start_m &&
           cn_height_sampler_sees(s, xyz, 2, 0);
}

static cn_status take_points(cloud *c, const cn_camera *camera, const cn_view *view)
{
    const cn_survey *survey = c->sampler.survey;
    const size_t n = (size_t)camera->width * camera->height;
    for (size_t i = 0; i < n; i++)
        for (size_t k = 0; k < 3; k++)
            c->display[3 * i + k] = c->picture.rgba[4 * i + k] / fmaxf(c->picture.rgba[4 * i + 3], 1e-6f);
    CN_TRY(cn_colour_to_display(
        survey->colour,
        &(cn_display_transform){ .view = survey->view, .look = survey->look, .exposure_ev = survey->exposure_ev },
        c->display, n, 3));
    station from = { camera, view, { 0 } };
    double xyz[3];
    cn_view_centre(view, from.eye);
    for (uint32_t y = 1; y + 1 < camera->height; y++)
        for (uint32_t x = 1; x + 1 < camera->width; x++) {
            bool fresh = false;
            if (lift_pixel(c, &from, x, y, xyz)) CN_TRY(cn_cubes_add(&c->cubes, xyz, &fresh));
            if (fresh) CN_TRY(cn_point_file_add(&c->file, xyz, c->display + 3 * ((size_t)y * camera->width + x)));
        }
    return ferror(c->file.writer.stream)
               ? cn_fail(CN_ERR_IO, "cannot write %s; make room and run the same command again", c->file.writer.path)
               : CN_OK;
}

static cn_status add_view(cloud *c, const cn_view *view)
{
    const cn_survey *survey = c->sampler.survey;
    const cn_camera *full = &survey->scene->cameras[view->camera];
    cn_camera camera;
    if (cn_stopping(&c->sampler.ctx))
        return cn_fail(CN_ERR_INTERRUPTED, "stopped while collecting points; run the same command again");
    /* As fine as the points are to lie. */
    const double width = fmax(32, fmin(round(survey->width_px * c->gsd_m / c->spacing_m), 4.0 * survey->width_px));
    cn_camera_resize(full, (uint32_t)width, (uint32_t)fmax(3, round((double)full->height * width / full->width)),
                     &camera);
    CN_TRY(cn_picture_init(&c->picture, camera.width, camera.height));
    c->display = malloc((size_t)camera.width * camera.height * 3 * sizeof *c->display);
    cn_status status = c->display ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory for the view of %s", view->name);
    if (status == CN_OK)
        status = cn_render_tile(&c->sampler.ctx, c->sampler.tile, &camera, view, &c->sampler.render, &c->picture);
    if (status == CN_OK) status = take_points(c, &camera, view);
    free(c->display);
    c->display = NULL;
    cn_picture_deinit(&c->picture);
    const double elapsed = cn_now_s() - c->started, done = ++c->views_done;
    const cn_progress_report report = { "export",     "points", done,
                                        c->views_all, elapsed,  elapsed / done * (c->views_all - done),
                                        NULL };
    cn_progress(&c->sampler.ctx, &report);
    return status;
}

/* The views by the tile that is nearest to them, tile by tile: views[first[t]] .. views[first[t + 1]]. */
static cn_status group_views(const cn_survey *survey, uint32_t *first, uint32_t *views)
{
    const uint32_t n_tiles = survey->n_tiles, n_views = survey->scene->n_views;
    double(*centres)[2] = calloc(n_tiles, sizeof *centres);
    uint32_t *home = calloc(n_views + (size_t)1, sizeof *home);
    cn_plane plane = { 0 };
    for (uint32_t t = 0; centres && t < n_tiles; t++)
        memcpy(centres[t], survey->tiles[t].centre, sizeof centres[t]);
    const bool fine = centres && home && cn_plane_init(&plane, (const double(*)[2])centres, NULL, n_tiles);
    for (uint32_t i = 0; i < n_views && fine; i++) {
        double eye[3];
        cn_view_centre(&survey->scene->views[i], eye);
        home[i] = cn_plane_nearest(&plane, eye);
        first[home[i] + 2]++;
    }
    for (uint32_t t = 2; t < n_tiles + 2 && fine; t++)
        first[t] += first[t - 1];
    for (uint32_t i = 0; i < n_views && fine; i++)
        views[first[home[i] + 1]++] = i;
    cn_plane_deinit(&plane);
    free(centres);
    free(home);
    return fine ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory for the tiles of %u photos", n_views);
}

static cn_status gather_tiles(cloud *c, const uint32_t *first, const uint32_t *views)
{
    const cn_survey *survey = c->sampler.survey;
    for (uint32_t t = 0; t < survey->n_tiles; t++) {
        CN_TRY(cn_height_sampler_open(&c->sampler, t));
        for (uint32_t i = first[t]; i < first[t + 1]; i++)
            CN_TRY(add_view(c, &survey->scene->views[views[i]]));
    }
    return c->file.n ? CN_OK
                     : cn_fail(CN_ERR_DATA,
                               "the tiles show no surface that two photos see; train longer, or look at the renders");
}

static cn_status gather(cloud *c)
{
    const cn_survey *survey = c->sampler.survey;
    uint32_t *first = calloc(survey->n_tiles + (size_t)2, sizeof *first);
    uint32_t *views = calloc(survey->scene->n_views + (size_t)1, sizeof *views);
    cn_status status = first && views ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory for the photos of tiles");
    if (status == CN_OK && survey->n_tiles) status = group_views(survey, first, views);
    if (status == CN_OK) status = gather_tiles(c, first, views);
    free(first);
    free(views);
    return status;
}

cn_status cn_export_points(const cn_context *ctx, const cn_survey *survey, const char *path, double spacing_m,
                           uint64_t *n_points)
{
    cloud c = { .gsd_m = cn_export_gsd(survey), .views_all = survey->scene->n_views, .started = cn_now_s() };
    c.spacing_m = spacing_m > 0 ? spacing_m : c.gsd_m;
    bool las;
    CN_TRY(cn_point_file_kind(path, &las)); /* before any work */
    CN_TRY(cn_height_sampler_init(&c.sampler, ctx, survey));
    cn_cubes_init(&c.cubes, c.spacing_m);
    cn_status status = cn_point_file_open(&c.file, survey, path, c.spacing_m);
    if (status == CN_OK) status = gather(&c);
    if (status == CN_OK) status = cn_point_file_finish(&c.file);
    const uint64_t n = c.file.n;
    cn_point_file_abort(&c.file);
    cn_cubes_deinit(&c.cubes);
    cn_height_sampler_deinit(&c.sampler);
    if (status == CN_OK && n_points) *n_points = n;
    return status;
}
