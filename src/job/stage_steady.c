/* How steady a path is: its frames, two at a time, never on disk. */
#include "job/match.h"
#include "job/route.h"

#include "conurb/colour.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

typedef struct steady_job {
    const cn_context *ctx;
    cn_material m; cn_gallery gallery; cn_path path; cn_colour *colour;
    cn_light light;
    cn_picture picture[2]; float *border[2]; char tile[2][32]; /* the frame before and this one, by turns */
    cn_steady *steady;
} steady_job;

static double now_s(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

/* Display-encoded, three floats a pixel. */
static cn_status show(steady_job *j, uint32_t i)
{
    const cn_path_frame *frame = &j->path.frames[i];
    cn_picture *p = &j->picture[i % 2];
    const cn_render_options options = cn_render_options_default();
    const size_t n = (size_t)p->width * p->height;
    CN_TRY(cn_gallery_view(&j->gallery, j->ctx, &frame->camera, &frame->view, &options, &j->light, p, j->tile[i % 2], j->border[i % 2]));
    CN_TRY(cn_colour_to_display(j->colour, "sRGB", NULL, 0, p->rgba, n, 4));
    for (size_t k = 0; k < n; k++)
        for (size_t c = 0; c < 3; c++) p->rgba[3 * k + c] = p->rgba[4 * k + c];
    return CN_OK;
}

static cn_steady_frame frame_of(const steady_job *j, uint32_t i)
{
    const cn_picture *p = &j->picture[i % 2];
    return (cn_steady_frame){p->width, p->height, p->rgba, p->depth, j->border[i % 2], &j->path.frames[i].camera, &j->path.frames[i].view};
}

static cn_status fly(steady_job *j)
{
    const double started = now_s();
    for (uint32_t i = 0; i < j->path.n_frames; i++) {
        if (cn_stopping(j->ctx)) return cn_fail(CN_ERR_INTERRUPTED, "stopped at frame %u; nothing is kept of what was measured", i);
        CN_TRY(show(j, i));
        if (i > 0) {
            const cn_steady_frame before = frame_of(j, i - 1), after = frame_of(j, i);
            const bool nearest = j->gallery.compose.scheme == CN_BLEND_NEAREST;
            cn_measure_steady(j->steady, &before, &after, nearest && strcmp(j->tile[0], j->tile[1]) != 0);
        }
        const double elapsed = now_s() - started, done = i + 1.0, n = j->path.n_frames;
        const cn_progress_report report = {"steady", NULL, done, n, elapsed, elapsed / done * (n - done), NULL};
        cn_progress(j->ctx, &report);
    }
    return CN_OK;
}

static cn_status prepare(steady_job *j, cn_city *city, const cn_city_render_options *o)
{
    CN_TRY(cn_light_parse(&j->light, o->appearance, city, &j->m.photos));
    CN_TRY(cn_gallery_init(&j->gallery, j->ctx, city, &j->m));
    if (o->blend) CN_TRY(cn_blend_parse(o->blend, &j->gallery.compose.scheme));
    CN_TRY(cn_route_choose(j->ctx, city, &j->m, o, &j->path));
    CN_TRY(cn_colour_create(&j->colour, NULL));
    CN_TRY(cn_gallery_match(&j->gallery, j->ctx, &j->light, true, NULL));
    j->steady = calloc(1, sizeof *j->steady);
    for (int k = 0; k < 2; k++) {
        const cn_camera *c = &j->path.frames[0].camera;
        CN_TRY(cn_picture_init(&j->picture[k], c->width, c->height));
        j->border[k] = calloc((size_t)c->width * c->height, sizeof(float));
    }
    return j->steady && j->border[0] && j->border[1] ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory");
}

cn_status cn_city_steady(const cn_context *ctx, cn_city *city, const cn_city_render_options *options, cn_steady_figures *figures)
{
    steady_job j = {.ctx = ctx};
    CN_TRY(cn_material_load(ctx, city, true, &j.m));
    cn_status status = prepare(&j, city, options);
    if (status == CN_OK) status = fly(&j);
    if (status == CN_OK) *figures = cn_measure_steady_figures(j.steady);
    for (int k = 0; k < 2; k++) {
        cn_picture_deinit(&j.picture[k]);
        free(j.border[k]);
    }
    free(j.steady);
    cn_path_deinit(&j.path);
    cn_colour_destroy(&j.colour);
    cn_gallery_deinit(&j.gallery);
    cn_light_deinit(&j.light);
    cn_material_deinit(&j.m);
    return status;
}
