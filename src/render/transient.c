/* Renders transients: the layers of one photo that normal renders leave out. */
#include "device/device.h"
#include "base/arena.h"
#include "conurb/render.h"
#include "tile/model.h"

#include <math.h>

typedef struct job {
    const cn_tile *tile;
    cn_effect_pack pack; /* only with the effects that a render leaves out */
    cn_effect_state effects;
    uint32_t row;
    cn_picture *picture;
    float **saved; /* a thread each */
} job;

/* A row of pixels, a call's worth of rays at a time: once before black and once before white, which tells alpha. */
static void render_row(void *user, size_t y, unsigned thread)
{
    const job *j = user;
    const uint32_t width = j->picture->width;
    for (uint32_t first = 0; first < width; first += CN_EFFECT_RAYS) {
        static const float up[CN_EFFECT_RAYS][3];
        float uv[CN_EFFECT_RAYS][2], through[CN_EFFECT_RAYS] = { 0 }, rgb[2][CN_EFFECT_RAYS][3];
        uint32_t photo[CN_EFFECT_RAYS];
        const uint32_t n = width - first < CN_EFFECT_RAYS ? width - first : CN_EFFECT_RAYS;
        for (uint32_t i = 0; i < n; i++) {
            uv[i][0] = 2 * ((float)(first + i) + 0.5f) / (float)width - 1;
            uv[i][1] = 2 * ((float)y + 0.5f) / (float)j->picture->height - 1;
            photo[i] = j->row;
            for (int c = 0; c < 3; c++)
                rgb[0][i][c] = 0, rgb[1][i][c] = 1;
        }
        const cn_effect_rays rays = { n, &up[0][0], &uv[0][0], photo, NULL };
        for (int k = 0; k < 2; k++)
            cn_effects_shade(&j->pack, &rays, &j->effects, through, &rgb[k][0][0], j->saved[thread]);
        for (uint32_t i = 0; i < n; i++) {
            float *out = j->picture->rgba + 4 * (y * width + first + i);
            for (int c = 0; c < 3; c++)
                out[c] = rgb[0][i][c];
            out[3] = fminf(fmaxf(1 - (rgb[1][i][1] - rgb[0][i][1]), 0), 1);
        }
    }
}

/* Keeps only the effects that a render leaves out. */
static void only_left_out(cn_effect_pack *pack)
{
    pack->background.n = 0;
    uint32_t n = 0;
    for (uint32_t i = 0; i < pack->pixel.n; i++)
        if (pack->on[pack->pixel.step[i]].effect->training_only) pack->pixel.step[n++] = pack->pixel.step[i];
    pack->pixel.n = n;
}

static int64_t row_of(const cn_tile *tile, const char *photo)
{
    for (uint32_t i = 0; i < tile->n_trained; i++)
        if (strcmp(tile->names[i], photo) == 0) return i;
    return -1;
}

cn_status cn_render_transient(const cn_context *ctx, const cn_tile *tile, const char *photo, cn_picture *picture)
{
    job j = { .tile = tile, .pack = tile->pack, .picture = picture };
    const int64_t row = row_of(tile, photo);
    if (row < 0)
        return cn_fail(CN_ERR_USAGE, "tile %s was not trained on %s: nothing is known of its transients", tile->id,
                       photo);
    only_left_out(&j.pack);
    if (!j.pack.pixel.n)
        return cn_fail(CN_ERR_DATA,
                       "tile %s has no transients: set effects.transient to on in city.yaml, plan and train again",
                       tile->id);
    j.row = (uint32_t)row;
    j.effects = (cn_effect_state){ cn_device_kernel(ctx, false), tile->constants, tile->effect_params, tile->shared,
                                   tile->derived };
    const unsigned threads = cn_pool_threads(ctx->pool);
    const size_t floats = tile->pack.saved * CN_EFFECT_RAYS;
    cn_arena counter, arena = { 0 };
    cn_arena_count(&counter);
    cn_arena_take(&counter, threads, sizeof *j.saved);
    for (unsigned i = 0; i < threads; i++)
        cn_arena_take(&counter, floats, sizeof(float));
    CN_TRY(cn_device_arena_init(ctx, &arena, counter.used));
    j.saved = CN_ARENA_NEW(&arena, float *, threads);
    for (unsigned i = 0; i < threads; i++)
        j.saved[i] = CN_ARENA_NEW(&arena, float, floats);
    const cn_op op = { .kind = CN_OP_PIXELS, .item = render_row };
    const cn_chain chain = { &op, 1, picture->height, &j };
    const cn_status status = cn_device_run(ctx, &chain, 1);
    cn_device_arena_deinit(ctx, &arena);
    return status;
}
