#include "stage/signed_distance.h"

#include <math.h>
#include <stdlib.h>

#define MOST_BYTES 2000000000u

static cn_status open_tile(cn_city_distance *d, const cn_context *ctx, uint32_t i, uint64_t *bytes)
{
    CN_TRY(cn_tile_open(&d->tiles[i], d->survey->tiles[i].path));
    *bytes += cn_tile_bytes(d->tiles[i]);
    if (!d->tiles[i]->field.type->distance || *bytes > MOST_BYTES) {
        cn_tile_close(&d->tiles[i]);
        return CN_OK;
    }
    for (unsigned t = 0; t < d->threads; t++)
        CN_TRY(cn_density_probe_init(&d->probes[(size_t)i * d->threads + t], ctx, d->tiles[i]));
    d->any = true;
    return CN_OK;
}

cn_status cn_city_distance_init(cn_city_distance *d, const cn_context *ctx, const cn_survey *survey)
{
    uint64_t bytes = 0;
    *d = (cn_city_distance){ .survey = survey, .threads = cn_pool_threads(ctx ? ctx->pool : NULL) };
    d->tiles = calloc(survey->n_tiles + (size_t)1, sizeof *d->tiles);
    d->probes = calloc((survey->n_tiles + (size_t)1) * d->threads, sizeof *d->probes);
    cn_status status = d->tiles && d->probes ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory for the tiles' distances");
    for (uint32_t i = 0; i < survey->n_tiles && status == CN_OK && bytes <= MOST_BYTES; i++)
        status = open_tile(d, ctx, i, &bytes);
    if (status == CN_OK && bytes <= MOST_BYTES) return CN_OK;
    cn_city_distance_deinit(d);
    return status;
}

void cn_city_distance_deinit(cn_city_distance *d)
{
    for (uint32_t i = 0; d->tiles && i < d->survey->n_tiles; i++) {
        for (unsigned t = 0; d->probes && t < d->threads; t++)
            cn_density_probe_deinit(&d->probes[(size_t)i * d->threads + t]);
        cn_tile_close(&d->tiles[i]);
    }
    free(d->tiles);
    free(d->probes);
    *d = (cn_city_distance){ 0 };
}

static uint32_t nearest(const cn_survey *survey, const double xyz[3])
{
    uint32_t found = 0;
    double least = INFINITY;
    for (uint32_t i = 0; i < survey->n_tiles; i++) {
        const double far = hypot(xyz[0] - survey->tiles[i].centre[0], xyz[1] - survey->tiles[i].centre[1]);
        if (far < least) least = far, found = i;
    }
    return found;
}

void cn_city_distance_at(const cn_city_distance *d, unsigned worker, size_t n, const double (*xyz)[3],
                         float *distance_m)
{
    for (size_t i = 0, end; i < n; i = end) {
        const uint32_t tile = nearest(d->survey, xyz[i]);
        for (end = i + 1; end < n && nearest(d->survey, xyz[end]) == tile;)
            end++;
        if (d->tiles[tile])
            cn_density_probe_distance(&d->probes[(size_t)tile * d->threads + worker], end - i, xyz + i, distance_m + i);
        for (size_t k = i; !d->tiles[tile] && k < end; k++)
            distance_m[k] = NAN;
    }
}
