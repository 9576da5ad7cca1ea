/* Temporal consistency of a path: compares each two frames in memory and writes none to disk. */
#include "renderer/renderer.h"
#include "stage/camera_path.h"

#include "base/clock.h"
#include "conurb/colour.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

typedef struct consistency_job {
    const cn_context *ctx;
    cn_dataset m;
    cn_renderer *renderer;
    cn_path path;
    cn_colour *colour;
    cn_appearance_spec spec;
    cn_picture picture[2];
    float *border[2];
    char tile[2][32]; /* the tile of this frame and of the frame before, alternating */
    uint32_t *owner;
    bool *owns;
    float **alone; /* of this frame: the owner of each pixel; for each tile whether it owns any, and its own render */
    cn_temporal *sums;
    cn_seam seam;
} consistency_job;

/* Display-encoded, three floats a pixel; by Conurb's own config, so that figures do not depend on $OCIO. */
static cn_status encode(const consistency_job *j, cn_picture *p)
{
    const size_t n = (size_t)p->width * p->height;
    CN_TRY(cn_colour_to_display(j->colour, &(cn_display_transform){ .view = "sRGB" }, p->rgba, n, 4));
    for (size_t k = 0; k < n; k++)
        for (size_t c = 0; c < 3; c++)
            p->rgba[3 * k + c] = p->rgba[4 * k + c];
    return CN_OK;
}

static cn_status show(consistency_job *j, uint32_t i)
{
    const cn_path_frame *frame = &j->path.frames[i];
    cn_picture *p = &j->picture[i % 2];
    const cn_render_options options = cn_render_options_default();
    const cn_tile_cache_view view = { .camera = &frame->camera,
                                      .view = &frame->view,
                                      .options = &options,
                                      .appearance = &j->spec,
                                      .used = j->tile[i % 2],
                                      .border = j->border[i % 2],
                                      .owner = j->owner };
    CN_TRY(cn_renderer_draw(j->renderer, j->ctx, &view, CN_RENDERER_BLEND, p));
    return encode(j, p);
}

/* Renders a tile that owns some of the frame alone. */
static cn_status show_alone(consistency_job *j, uint32_t i, uint32_t tile)
{
    const cn_path_frame *frame = &j->path.frames[i];
    const cn_render_options options = cn_render_options_default();
    cn_picture p;
    CN_TRY(cn_picture_init(&p, j->picture[0].width, j->picture[0].height));
    const cn_tile_cache_view view = {
        .camera = &frame->camera, .view = &frame->view, .options = &options, .appearance = &j->spec
    };
    cn_status status = cn_renderer_draw(j->renderer, j->ctx, &view, tile, &p);
    if (status == CN_OK) status = encode(j, &p);
    j->alone[tile] = p.rgba;
    p.rgba = NULL;
    cn_picture_deinit(&p);
    return status;
}

static void forget_alone(consistency_job *j)
{
    for (uint32_t t = 0; j->alone && t < j->renderer->tiles.n; t++) {
        free(j->alone[t]);
        j->alone[t] = NULL;
    }
}

/* The seams of a frame, if it belongs to several tiles. */
static cn_status look_for_seams(consistency_job *j, uint32_t i)
{
    const cn_picture *p = &j->picture[i % 2];
    const size_t n = (size_t)p->width * p->height;
    uint32_t n_owners = 0;
    memset(j->owns, 0, j->renderer->tiles.n * sizeof *j->owns);
    for (size_t k = 0; k < n; k++) {
        if (j->owner[k] == UINT32_MAX || j->owns[j->owner[k]]) continue;
        j->owns[j->owner[k]] = true;
        n_owners++;
    }
    cn_status status = CN_OK;
    for (uint32_t t = 0; t < j->renderer->tiles.n && n_owners > 1 && status == CN_OK; t++)
        if (j->owns[t]) status = show_alone(j, i, t);
    const cn_seam_frame frame = {
        p->width, p->height, p->rgba, j->border[i % 2], j->owner, (const float *const *)j->alone, j->renderer->tiles.n
    };
    if (n_owners > 1 && status == CN_OK) cn_measure_seam(&j->seam, &frame);
    forget_alone(j);
    return status;
}

static cn_temporal_frame frame_of(const consistency_job *j, uint32_t i)
{
    const cn_picture *p = &j->picture[i % 2];
    return (cn_temporal_frame){
        p->width, p->height, p->rgba, p->depth, j->border[i % 2], &j->path.frames[i].camera, &j->path.frames[i].view
    };
}

static cn_status fly(consistency_job *j)
{
    const double started = cn_now_s();
    for (uint32_t i = 0; i < j->path.n_frames; i++) {
        if (cn_stopping(j->ctx))
            return cn_fail(CN_ERR_INTERRUPTED,
                           "stopped at frame %u; no measurement is kept; run the same command again", i);
        CN_TRY(show(j, i));
        CN_TRY(look_for_seams(j, i));
        if (i > 0) {
            const cn_temporal_frame before = frame_of(j, i - 1), after = frame_of(j, i);
            const bool nearest = j->renderer->tiles.compose.scheme == CN_BLEND_NEAREST;
            cn_measure_temporal(j->sums, &before, &after, nearest && strcmp(j->tile[0], j->tile[1]) != 0);
        }
        const double elapsed = cn_now_s() - started, done = i + 1.0, n = j->path.n_frames;
        const cn_progress_report report = { "steady", NULL, done, n, elapsed, elapsed / done * (n - done), NULL };
        cn_progress(j->ctx, &report);
    }
    return CN_OK;
}

static cn_status prepare(consistency_job *j, cn_city *city, const cn_city_render_options *o)
{
    CN_TRY(cn_appearance_spec_parse(&j->spec, o->appearance, city, &j->m.photos));
    CN_TRY(cn_renderer_open(&j->renderer, j->ctx, city, &j->m, "tiles"));
    if (o->blend) CN_TRY(cn_blend_parse(o->blend, &j->renderer->tiles.compose.scheme));
    CN_TRY(cn_route_choose(j->ctx, city, &j->m, o, &j->path));
    CN_TRY(cn_colour_create(&j->colour, ""));
    CN_TRY(cn_renderer_align(j->renderer, j->ctx, &j->spec, true, NULL));
    j->sums = calloc(1, sizeof *j->sums);
    j->owner = calloc((size_t)j->path.frames[0].camera.width * j->path.frames[0].camera.height, sizeof *j->owner);
    j->owns = calloc(j->renderer->tiles.n, sizeof *j->owns);
    j->alone = calloc(j->renderer->tiles.n, sizeof *j->alone);
    for (int k = 0; k < 2; k++) {
        const cn_camera *c = &j->path.frames[0].camera;
        CN_TRY(cn_picture_init(&j->picture[k], c->width, c->height));
        j->border[k] = calloc((size_t)c->width * c->height, sizeof(float));
    }
    const bool room = j->sums && j->owner && j->owns && j->alone && j->border[0] && j->border[1];
    return room ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory");
}

cn_status cn_city_temporal_consistency(const cn_context *ctx, cn_city *city, const cn_city_render_options *options,
                                       cn_temporal_figures *sums, cn_seam_figures *seam)
{
    consistency_job j = { .ctx = ctx };
    CN_TRY(cn_dataset_load(ctx, city, true, &j.m));
    cn_status status = prepare(&j, city, options);
    if (status == CN_OK) status = fly(&j);
    if (status == CN_OK) {
        *sums = cn_measure_temporal_figures(j.sums);
        *seam = cn_measure_seam_figures(&j.seam);
    }
    for (int k = 0; k < 2; k++) {
        cn_picture_deinit(&j.picture[k]);
        free(j.border[k]);
    }
    free(j.sums);
    free(j.owner);
    free(j.owns);
    free(j.alone);
    cn_path_deinit(&j.path);
    cn_colour_destroy(&j.colour);
    cn_renderer_destroy(&j.renderer);
    cn_appearance_spec_deinit(&j.spec);
    cn_dataset_deinit(&j.m);
    return status;
}
