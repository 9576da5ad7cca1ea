/* One pass of a job: renders the picture and encodes it. */
#include "bridge/oiio.h"
#include "renderer/renderer.h"

#include <stdlib.h>
#include <string.h>

static int coarsest(unsigned passes)
{
    int pass = CN_PASS_EIGHTH;
    while (!(passes & (unsigned)pass))
        pass <<= 1;
    return pass;
}

/* A side of a pass: CN_PASS_EIGHTH is 1, CN_PASS_FULL is 8. */
static uint32_t side(uint32_t full, int pass)
{
    const uint32_t divisor = CN_PASS_FULL / (uint32_t)pass;
    return full / divisor + (full % divisor > 0);
}

static cn_status check_stop(const cn_context *ctx)
{
    return cn_stopping(ctx) ? cn_fail(CN_ERR_INTERRUPTED, "the job was cancelled") : CN_OK;
}

/* Use the tiles as they are now: alignments may belong to tiles that have changed. */
static cn_status prepare(cn_renderer *r, cn_render_job *job, const cn_context *ctx)
{
    cn_tile_cache_refresh(&r->tiles);
    if (!job->prepared) {
        CN_TRY(cn_appearance_spec_parse(&job->spec, job->request.appearance, r->city, &r->dataset->photos));
        job->prepared = true;
    }
    r->tiles.compose = r->city->config.compose;
    if (job->request.blend) CN_TRY(cn_blend_parse(job->request.blend, &r->tiles.compose.scheme));
    return job->request.row ? CN_OK : cn_tile_cache_align(&r->tiles, ctx, &job->spec, !r->read_only, NULL);
}

/* The result of a pass. */
typedef struct pass_output {
    cn_picture picture;
    uint32_t *owners; /* as the tile cache has them while it draws, then as the plan has them */
    cn_aovs aovs;
    uint8_t *bytes;
    size_t size;
} pass_output;

/* tile: the one that is shown alone, or UINT32_MAX. Only the full pass waits for the photos' depths at full width. */
static cn_status draw_aovs(cn_renderer *r, const cn_render_job *job, const cn_tile_cache_view *view, uint32_t tile,
                           const cn_context *ctx, pass_output *out)
{
    const cn_aov_source source = { .camera = view->camera,
                                   .view = view->view,
                                   .picture = &out->picture,
                                   .owner = tile == UINT32_MAX ? out->owners : NULL,
                                   .tile = tile,
                                   .coarse =
                                       job->request.draft || job->passes & (CN_PASS_EIGHTH | CN_PASS_QUARTER) ? 8 : 1 };
    if (!job->request.aovs) return CN_OK;
    CN_TRY(cn_aovs_init(&out->aovs, out->picture.width, out->picture.height, job->request.aovs));
    return cn_aovs_fill(&r->tiles, ctx, &source, &out->aovs);
}

static cn_status draw(cn_renderer *r, cn_render_job *job, const cn_context *ctx, const cn_camera *camera,
                      pass_output *out)
{
    uint32_t *owner = out->owners;
    cn_picture *picture = &out->picture;
    cn_render_options options = cn_render_options_default();
    options.samples = &job->samples;
    options.crop_m = job->request.crop_m;
    const char *tile = job->request.tile;
    const cn_tile_cache_view view = { .camera = camera,
                                      .view = &job->request.view,
                                      .options = &options,
                                      .appearance = &job->spec,
                                      .row = job->request.row,
                                      .used = job->result.tile,
                                      .owner = owner,
                                      .owner_by_all = true };
    CN_TRY(prepare(r, job, ctx));
    CN_TRY(check_stop(ctx));
    if (!tile) {
        CN_TRY(cn_tile_cache_blend(&r->tiles, ctx, &view, picture));
        CN_TRY(draw_aovs(r, job, &view, UINT32_MAX, ctx, out));
        for (size_t i = 0; owner && i < (size_t)picture->width * picture->height; i++)
            if (owner[i] != UINT32_MAX) owner[i] = r->tiles.which[owner[i]];
        return CN_OK;
    }
    for (uint32_t i = 0; i < r->tiles.n; i++) {
        if (strcmp(r->tiles.plan->tiles[r->tiles.which[i]].id, tile) != 0) continue;
        snprintf(job->result.tile, sizeof job->result.tile, "%s", tile);
        CN_TRY(cn_tile_cache_alone(&r->tiles, ctx, i, &view, picture));
        for (size_t k = 0; owner && k < (size_t)picture->width * picture->height; k++)
            owner[k] = picture->rgba[4 * k + 3] > 0 ? r->tiles.which[i] : UINT32_MAX;
        return draw_aovs(r, job, &view, i, ctx, out);
    }
    return cn_fail(CN_ERR_USAGE, "no trained tile is named '%s'; see plan/plan.json", tile);
}

static cn_status encode(const cn_renderer *r, const cn_render_job *job, const cn_picture *p, uint8_t **bytes,
                        size_t *size)
{
    const cn_config *c = &r->city->config;
    const cn_render_request *q = &job->request;
    float *display;
    CN_TRY(cn_renderer_display(r->colour,
                               &(cn_display_transform){ .view = q->display_view ? q->display_view : c->view,
                                                        .look = q->look ? q->look : c->look,
                                                        .exposure_ev = c->exposure_ev + q->exposure_ev },
                               q->crop_m ? CN_UNSEEN_BLACK : c->unseen, p, &display));
    const cn_oiio_encoding encoding = { .jpeg = q->encoding == CN_ENCODING_JPEG,
                                        .quality = q->quality ? q->quality : 90 };
    const cn_status status = cn_oiio_encode(encoding, display, p->width, p->height, bytes, size);
    free(display);
    return status;
}

static cn_status make_room(const cn_render_request *q, const cn_camera *camera, pass_output *out)
{
    CN_TRY(cn_picture_init(&out->picture, camera->width, camera->height));
    /* Channels of one tile alone know whose its pixels are. */
    if (!q->owners && (q->tile || !cn_aov_needs_owner(q->aovs))) return CN_OK;
    out->owners = malloc((size_t)camera->width * camera->height * sizeof *out->owners);
    return out->owners ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory for the owners of pixels");
}

static cn_status draw_and_encode(cn_renderer *r, cn_render_job *job, const cn_context *ctx, int pass, pass_output *out)
{
    const cn_camera *full = &job->request.camera;
    cn_camera camera = *full;
    if (pass != CN_PASS_FULL) cn_camera_resize(full, side(full->width, pass), side(full->height, pass), &camera);
    CN_TRY(make_room(&job->request, &camera, out));
    pthread_mutex_lock(&r->turn);
    cn_status status = check_stop(ctx);
    if (status == CN_OK) status = draw(r, job, ctx, &camera, out);
    pthread_mutex_unlock(&r->turn);
    if (status == CN_OK) status = check_stop(ctx);
    if (status == CN_OK && job->request.encoding != CN_ENCODING_NONE)
        status = encode(r, job, &out->picture, &out->bytes, &out->size);
    return status == CN_OK ? check_stop(ctx) : status;
}

cn_status cn_render_job_pass(cn_renderer *r, cn_render_job *job)
{
    const int pass = coarsest(job->passes);
    cn_context ctx = r->ctx;
    pass_output out = { 0 };
    ctx.stop = &job->stop;
    ctx.progress = NULL; /* no progress reports of stages */
    const cn_status status = draw_and_encode(r, job, &ctx, pass, &out);
    if (status != CN_OK) {
        cn_picture_deinit(&out.picture);
        cn_aovs_deinit(&out.aovs);
        free(out.owners);
        free(out.bytes);
        return status;
    }
    cn_picture_deinit(&job->picture);
    cn_aovs_deinit(&job->aovs);
    free(job->encoded);
    free(job->owners);
    job->picture = out.picture;
    job->owners = out.owners;
    job->aovs = out.aovs;
    job->encoded = out.bytes;
    job->passes &= ~(unsigned)pass;
    job->result.pass = pass;
    job->result.picture = &job->picture;
    job->result.owners = job->request.owners ? out.owners : NULL;
    job->result.aovs = job->request.aovs ? &job->aovs : NULL;
    job->result.encoded = out.bytes;
    job->result.encoded_size = out.size;
    return CN_OK;
}
