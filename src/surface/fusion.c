#include "surface/fusion.h"

#include "math/linalg.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Weight of a map that sees past the place, against one that shows a surface near it. Below 1: a depth that falls into
 * a hole of the field must not carve away what other maps agree on. */
#define EMPTY_WEIGHT 0.3
/* Of a depth that stereo has not moved, where it has moved others. */
#define RENDERED_WEIGHT 0.3

cn_status cn_fusion_add(cn_fusion *f, const int32_t at[3], bool own)
{
    bool fresh;
    if (f->n == f->room) {
        const uint32_t room = f->room ? 2 * f->room : 256;
        cn_fusion_block *blocks = realloc(f->blocks, room * sizeof *blocks);
        if (!blocks) return cn_fail(CN_ERR_NOMEM, "out of memory for %u blocks of a mesh; give a larger --gsd", room);
        f->blocks = blocks;
        f->room = room;
    }
    CN_TRY(cn_keys_add(&f->slots, cn_lattice_key(at), f->n, &fresh));
    if (!fresh) return CN_OK;
    cn_fusion_block *b = &f->blocks[f->n++];
    memset(b, 0, sizeof *b);
    memset(b->vertex, 0xff, sizeof b->vertex);
    memcpy(b->at, at, sizeof b->at);
    b->own = own;
    return CN_OK;
}

void cn_fusion_clear(cn_fusion *f)
{
    cn_keys_deinit(&f->slots);
    f->n = 0;
}

void cn_fusion_deinit(cn_fusion *f)
{
    cn_keys_deinit(&f->slots);
    free(f->blocks);
    *f = (cn_fusion){ 0 };
}

static void fuse_map(const cn_fusion *f, const cn_depth_map *map, cn_fusion_block *b)
{
    const double band = CN_LATTICE_BAND * f->cube_m;
    for (int i = 0; i < CN_LATTICE_POINTS; i++) {
        const int32_t in[3] = { i % CN_LATTICE_SIDE, i / CN_LATTICE_SIDE % CN_LATTICE_SIDE,
                                i / (CN_LATTICE_SIDE * CN_LATTICE_SIDE) };
        double xyz[3];
        cn_depth_sight sight;
        for (int k = 0; k < 3; k++)
            xyz[k] = f->cube_m * (b->at[k] * CN_LATTICE_SIDE + in[k]);
        if (!cn_depth_map_look(f->maps, map, xyz, &sight)) continue;
        const double reach = sight.pixel->band * f->cube_m, wide = reach / band;
        if (sight.sight_m < -reach) continue;
        double weight = 1 / (sight.distance_m * sight.distance_m * wide * wide); /* a depth's error grows with both */
        if (cn_depth_pixel_moved(f->maps, sight.pixel))
            b->moved[i] = true;
        else if (f->maps->rendered)
            weight *= RENDERED_WEIGHT;
        if (sight.sight_m > reach)
            weight *= EMPTY_WEIGHT;
        else if (sight.sight_m < 0) /* less and less behind the surface: what is there may be another one */
            weight *= 1 + sight.sight_m / reach;
        if (sight.sight_m <= reach && b->seen[i] < 255) b->seen[i]++;
        b->distance[i] += (float)(weight * fmin(sight.sight_m, reach) / band);
        b->weight[i] += (float)weight;
    }
}

/* The mean of the field's own distance and of what the maps say. The field's zero lies beside what its renders show by
 * some widths of its density, differently from place to place; the maps have flakes where they disagree. What stereo
 * says is better than both: there the field's distance does not count. */
static void measure_block(const cn_fusion *f, cn_fusion_block *b, unsigned worker)
{
    const double band = CN_LATTICE_BAND * f->cube_m;
    double xyz[CN_LATTICE_POINTS][3];
    float distance_m[CN_LATTICE_POINTS];
    int point[CN_LATTICE_POINTS];
    size_t n = 0;
    for (int i = 0; i < CN_LATTICE_POINTS; i++) {
        const int32_t in[3] = { i % CN_LATTICE_SIDE, i / CN_LATTICE_SIDE % CN_LATTICE_SIDE,
                                i / (CN_LATTICE_SIDE * CN_LATTICE_SIDE) };
        if (!(b->weight[i] > 0)) continue;
        for (int k = 0; k < 3; k++)
            xyz[n][k] = f->cube_m * (b->at[k] * CN_LATTICE_SIDE + in[k]);
        point[n++] = i;
    }
    f->measure(f->user, worker, n, (const double(*)[3])xyz, distance_m);
    for (size_t i = 0; i < n; i++)
        if (isfinite(distance_m[i])) {
            float *of = &b->distance[point[i]];
            if (b->moved[point[i]]) continue;
            *of += 0.5f * ((float)fmin(fmax((double)distance_m[i] / band, -1), 1) - *of);
        }
}

static void fuse_block(void *user, size_t i, unsigned worker)
{
    cn_fusion *f = user;
    cn_fusion_block *b = &f->blocks[i];
    const double side = CN_LATTICE_SIDE * f->cube_m;
    double centre[3];
    if (cn_stopping(f->ctx)) return;
    for (int k = 0; k < 3; k++)
        centre[k] = side * (b->at[k] + 0.5);
    for (uint32_t w = 0; w < f->n_which; w++) {
        const cn_depth_map *map = &f->maps->maps[f->which[w]];
        if (cn_depth_map_reaches(map, centre, side, CN_DEPTH_WIDEST * f->cube_m)) fuse_map(f, map, b);
    }
    for (int p = 0; p < CN_LATTICE_POINTS; p++)
        if (b->weight[p] > 0) b->distance[p] /= b->weight[p];
    if (f->measure) measure_block(f, b, worker);
}

void cn_fusion_run(cn_fusion *f)
{
    cn_pool_run(f->ctx->pool, f->n, fuse_block, f);
}
