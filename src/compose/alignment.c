/* One appearance in all tiles: rows are fitted from tile to tile along the overlap graph, beginning at a root. */
#include "compose/overlap.h"

#include "base/clock.h"
#include "base/srgb.h"
#include "conurb/train.h"
#include "tile/model.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { ROOM = 4 * CN_PLACES_EDGE }; /* rays a fit */
#define MIN_ALPHA 0.8f
#define SAME_DEPTH 0.1f /* relative difference of depth above which two tiles show different surfaces */

typedef struct aligner {
    const cn_context *ctx;
    const cn_alignment_input *in;
    cn_alignment *out;
    bool *done;
    uint32_t n_done;
    cn_places places;
    float (*mine)[4], (*target)[4], *depth;
    double started;
} aligner;

static double encode(double x)
{
    return cn_srgb_encode(fmin(fmax(x, 0), 1));
}

/* Renders the places from the first one on. */
static cn_status show(const aligner *m, const cn_tile *tile, const cn_appearance *row, size_t first, float (*rgba)[4],
                      float *depth)
{
    cn_render_options options = cn_render_options_default();
    options.appearance = row;
    return cn_render_rays(m->ctx, tile,
                          &(cn_ray_list){ m->places.n - first, (const double(*)[3])m->places.origin + first,
                                          (const double(*)[3])m->places.direction + first },
                          &options, rgba[0], depth);
}

/* The edge from `tile` to a tile that is matched: the other one, or UINT32_MAX. */
static uint32_t matched_end(const aligner *m, const cn_alignment_edge *e, uint32_t tile)
{
    const uint32_t other = e->a == tile ? e->b : e->b == tile ? e->a : UINT32_MAX;
    return other != UINT32_MAX && m->done[other] ? other : UINT32_MAX;
}

/* Rays to places shared with every aligned neighbour, and the neighbours' colours there. */
static cn_status ask_neighbours(aligner *m, uint32_t tile)
{
    uint32_t n = 0;
    m->places.n = 0;
    for (uint32_t e = 0; e < m->out->n_edges; e++)
        n += matched_end(m, &m->out->edges[e], tile) != UINT32_MAX;
    for (uint32_t e = 0; e < m->out->n_edges; e++) {
        const uint32_t other = matched_end(m, &m->out->edges[e], tile);
        const size_t first = m->places.n, share = n > 4 ? ROOM / n : CN_PLACES_EDGE;
        const cn_tile *open;
        if (other == UINT32_MAX) continue;
        CN_TRY(cn_places_add(&m->places, m->in, m->out->edges[e].a, m->out->edges[e].b, share));
        for (size_t i = first; i < m->places.n; i++)
            m->places.edge[i] = e;
        CN_TRY(m->in->open(m->in->user, other, &open));
        CN_TRY(show(m, open, &m->out->rows[other], first, m->places.rgba + first, m->places.depth + first));
    }
    return CN_OK;
}

/* Weight 1 for the places where both tiles show a similar depth, 0 for the others. */
static void choose_places(aligner *m)
{
    for (size_t i = 0; i < m->places.n; i++) {
        const float *theirs = m->places.rgba[i], there = m->places.depth[i], here = m->depth[i];
        const bool both = theirs[3] > MIN_ALPHA && m->mine[i][3] > MIN_ALPHA && there > 0 && here > 0 &&
                          fabsf(here - there) < SAME_DEPTH * there;
        memcpy(m->target[i], theirs, 3 * sizeof(float));
        m->target[i][3] = both ? 1 : 0;
    }
}

static void residual(const aligner *m, bool own)
{
    for (uint32_t e = 0; e < m->out->n_edges; e++) {
        cn_alignment_edge *edge = &m->out->edges[e];
        double sum = 0;
        uint32_t n = 0;
        bool asked = false;
        for (size_t i = 0; i < m->places.n; i++) {
            asked |= m->places.edge[i] == e;
            if (m->places.edge[i] != e || !(m->target[i][3] > 0)) continue;
            for (int c = 0; c < 3; c++)
                sum += pow(encode((double)m->mine[i][c]) - encode((double)m->target[i][c]), 2);
            n++;
        }
        if (!asked) continue;
        edge->n_places = n;
        const double rmse = n >= CN_PLACES_MIN ? sqrt(sum / (3.0 * n)) : NAN;
        if (own) edge->own_rmse = rmse;
        edge->rmse = rmse;
    }
}

/* Removes the places of edges with too few of them. Returns the number left. */
static size_t drop_thin_edges(aligner *m)
{
    size_t left = 0;
    for (size_t i = 0; i < m->places.n; i++) {
        if (m->out->edges[m->places.edge[i]].n_places < CN_PLACES_MIN) m->target[i][3] = 0;
        left += m->target[i][3] > 0;
    }
    return left;
}

static bool can_change(const cn_tile *tile)
{
    return cn_tile_has_appearance(tile) && tile->one.n_photo > 0;
}

/* *seen: whether any aligned neighbour sees the same places as this tile. Until it is fitted, the row is the tile's
 * own. */
static cn_status align_tile(aligner *m, uint32_t tile, bool *seen)
{
    cn_appearance *row = &m->out->rows[tile];
    const cn_tile *open;
    double rmse;
    CN_TRY(ask_neighbours(m, tile));
    CN_TRY(m->in->open(m->in->user, tile, &open));
    CN_TRY(m->in->appearance(m->in->user, m->ctx, open, row));
    *seen = false;
    if (!m->places.n) return CN_OK;
    CN_TRY(show(m, open, row, 0, m->mine, m->depth));
    choose_places(m);
    residual(m, true);
    *seen = drop_thin_edges(m) >= CN_PLACES_MIN;
    if (!*seen || !can_change(open)) return CN_OK;
    cn_appearance fitted = *row;
    cn_tile_appearance_unfreeze(open, &fitted);
    const cn_status status = cn_fit_appearance(
        m->ctx, open,
        &(cn_lit_rays){ { m->places.n, (const double(*)[3])m->places.origin, (const double(*)[3])m->places.direction },
                        m->target[0],
                        false },
        &fitted, &rmse);
    if (status == CN_ERR_DATA) return CN_OK; /* the training march sees less than the render's: its own row stays */
    CN_TRY(status);
    *row = fitted;
    CN_TRY(show(m, open, row, 0, m->mine, m->depth));
    residual(m, false);
    return CN_OK;
}

/* The tile not yet aligned that shares the most places with aligned ones. */
static uint32_t next_tile(const aligner *m, const bool *given_up)
{
    uint32_t best = UINT32_MAX;
    uint64_t most = 0;
    for (uint32_t t = 0; t < m->in->n_tiles; t++) {
        uint64_t places = 0;
        if (m->done[t] || given_up[t]) continue;
        for (uint32_t e = 0; e < m->out->n_edges; e++)
            if (matched_end(m, &m->out->edges[e], t) != UINT32_MAX) places += m->out->edges[e].n_places;
        if (places > most) most = places, best = t;
    }
    return best;
}

static void finish_tile(aligner *m, uint32_t tile, uint32_t group)
{
    m->done[tile] = true;
    m->out->group[tile] = group;
    m->out->order[m->n_done++] = tile;
    const double done = m->n_done, total = m->in->n_tiles, elapsed = cn_now_s() - m->started;
    const cn_progress_report report = { "match", m->in->tiles[tile].id,           done, total,
                                        elapsed, elapsed / done * (total - done), NULL };
    cn_progress(m->ctx, &report);
}

/* All tiles that can be reached from a root. */
static cn_status align_group(aligner *m, uint32_t root, uint32_t group, bool *given_up)
{
    const cn_tile *open;
    memset(given_up, 0, m->in->n_tiles * sizeof *given_up);
    CN_TRY(m->in->open(m->in->user, root, &open));
    CN_TRY(m->in->appearance(m->in->user, m->ctx, open, &m->out->rows[root]));
    finish_tile(m, root, group);
    for (uint32_t t; (t = next_tile(m, given_up)) != UINT32_MAX;) {
        bool seen;
        if (cn_stopping(m->ctx))
            return cn_fail(CN_ERR_INTERRUPTED, "stopped while aligning the tiles' light; run the same command again");
        CN_TRY(align_tile(m, t, &seen));
        if (!seen) {
            given_up[t] = true;
            continue;
        }
        finish_tile(m, t, group);
        memset(given_up, 0, m->in->n_tiles * sizeof *given_up); /* it may link others that were given up */
    }
    return CN_OK;
}

/* The tile with the most photos, among those not aligned. */
static uint32_t largest(const aligner *m)
{
    uint32_t best = UINT32_MAX;
    for (uint32_t t = 0; t < m->in->n_tiles; t++)
        if (!m->done[t] && (best == UINT32_MAX || m->in->tiles[t].n_views > m->in->tiles[best].n_views)) best = t;
    return best;
}

static void say_groups(const aligner *m)
{
    const cn_alignment *o = m->out;
    for (uint32_t i = 1, group = 0; i < m->n_done; i++) {
        if (o->group[o->order[i]] == group) continue;
        group = o->group[o->order[i]];
        cn_log(m->ctx, CN_LOG_WARN,
               "tile %s shares no places with the tiles before it: it and the tiles joined to it keep their own light "
               "(group %u of %u)",
               m->in->tiles[o->order[i]].id, group + 1, o->n_groups);
    }
}

static cn_status work(aligner *m, bool *given_up)
{
    uint32_t root = m->in->root < m->in->n_tiles ? m->in->root : largest(m);
    CN_TRY(cn_overlap_find(m->in, &m->out->edges, &m->out->n_edges));
    for (; root != UINT32_MAX; root = largest(m))
        CN_TRY(align_group(m, root, m->out->n_groups++, given_up));
    say_groups(m);
    return CN_OK;
}

cn_status cn_appearance_align(const cn_context *ctx, const cn_alignment_input *in, cn_alignment *out)
{
    *out = (cn_alignment){ .n_tiles = in->n_tiles };
    aligner m = { .ctx = ctx, .in = in, .out = out, .started = cn_now_s() };
    out->rows = calloc(in->n_tiles + 1u, sizeof *out->rows);
    out->group = calloc(in->n_tiles + 1u, sizeof *out->group);
    out->order = calloc(in->n_tiles + 1u, sizeof *out->order);
    m.done = calloc(in->n_tiles + 1u, sizeof *m.done);
    bool *given_up = calloc(in->n_tiles + 1u, sizeof *given_up);
    m.mine = malloc(ROOM * sizeof *m.mine);
    m.target = malloc(ROOM * sizeof *m.target);
    m.depth = malloc(ROOM * sizeof *m.depth);
    const bool room = out->rows && out->group && out->order && m.done && given_up && m.mine && m.target && m.depth;
    cn_status status = room ? cn_places_init(&m.places, ROOM)
                            : cn_fail(CN_ERR_NOMEM, "out of memory for the match of %u tiles", in->n_tiles);
    if (status == CN_OK) status = work(&m, given_up);
    cn_places_deinit(&m.places);
    free(m.done);
    free(given_up);
    free(m.mine);
    free(m.target);
    free(m.depth);
    if (status != CN_OK) cn_alignment_deinit(out);
    return status;
}

void cn_alignment_deinit(cn_alignment *alignment)
{
    free(alignment->rows);
    free(alignment->group);
    free(alignment->order);
    free(alignment->edges);
    *alignment = (cn_alignment){ 0 };
}
