/* The plan of the town: a grid of streets at uneven distances; blocks with houses along their edges around a court, and
 * a park at the crossing in the middle. */
#include "synth/town.h"

#include "base/rng.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { STREAM_TOWN = 1 };
#define BACKDROP_M 75.0f /* the town goes on this far around what is photographed */

float cn_town_random(uint32_t seed, uint32_t what)
{
    return cn_rng_float(seed, STREAM_TOWN, what);
}

cn_wall cn_lot_wall(uint32_t seed)
{
    return (cn_wall)(cn_town_random(seed, 1) * CN_WALL_KINDS);
}

float cn_lot_height(const cn_lot *lot)
{
    return lot->ground_floor_m + (float)lot->floors * lot->floor_m + 0.5f;
}

bool cn_town_near(const cn_town *town, float x, float y, float margin)
{
    return fabsf(x) < town->half_m + margin && fabsf(y) < town->half_m + margin;
}

static void *grow(void *items, uint32_t *n, uint32_t *room, size_t size)
{
    void **list = items;
    if (*n == *room) {
        const uint32_t more = *room ? *room * 2 : 64;
        void *grown = realloc(*list, more * size);
        if (!grown) return NULL;
        *list = grown;
        *room = more;
    }
    void *item = (char *)*list + (*n)++ * size;
    memset(item, 0, size);
    return item;
}

/* Axes at 46 to 58 m from one another, one of them at 0. */
static uint32_t lay_axes(uint32_t seed, float reach, float axes[CN_TOWN_STREETS], uint32_t *centre)
{
    float west[CN_TOWN_STREETS], at = 0;
    uint32_t n_west = 0, n = 0;
    while (at > -reach && n_west < CN_TOWN_STREETS / 2 - 1) {
        at -= cn_town_between(seed, 100 + n_west, 46, 58);
        west[n_west++] = at;
    }
    for (uint32_t i = n_west; i-- > 0;)
        axes[n++] = west[i];
    *centre = n;
    axes[n++] = at = 0;
    for (uint32_t i = 0; at < reach && n < CN_TOWN_STREETS; i++) {
        at += cn_town_between(seed, 200 + i, 46, 58);
        axes[n++] = at;
    }
    return n;
}

static bool inside(const cn_rect *r, float x, float y, float margin)
{
    return x > r->x0 - margin && x < r->x1 + margin && y > r->y0 - margin && y < r->y1 + margin;
}

static bool add_lot(cn_town *town, cn_rect rect, uint32_t seed, unsigned streets)
{
    cn_lot *lot = grow(&town->lots, &town->n_lots, &town->room_lots, sizeof *lot);
    if (!lot) return false;
    lot->rect = rect;
    lot->seed = seed;
    lot->ground_floor_m = cn_town_between(seed, 2, 3.4f, 4.3f);
    lot->floor_m = cn_town_between(seed, 3, 2.9f, 3.4f);
    lot->floors = 1 + (uint32_t)(cn_town_random(seed, 4) * 4);
    lot->gable_m = cn_town_random(seed, 5) < 0.5f ? cn_town_between(seed, 6, 2.5f, 4) : 0;
    lot->near = cn_town_near(town, 0.5f * (rect.x0 + rect.x1), 0.5f * (rect.y0 + rect.y1), 22);
    for (int side = 0; side < 4; side++)
        lot->street[side] = streets >> side & 1;
    return true;
}

/* Houses in a row along x. */
static bool add_row(cn_town *town, cn_rect row, uint32_t seed, bool north)
{
    const float x0 = row.x0, x1 = row.x1;
    const uint32_t n = (uint32_t)fmaxf(2, floorf((x1 - x0) / cn_town_between(seed, 10, 9, 13)));
    float at = x0;
    for (uint32_t i = 0; i < n; i++) {
        const float even = x0 + (x1 - x0) * (float)(i + 1) / (float)n;
        const float end = i + 1 < n ? even + cn_town_between(seed, 20 + i, -1.3f, 1.3f) : x1;
        const float set_back = cn_town_random(seed, 40 + i) < 0.3f ? cn_town_between(seed, 60 + i, 0.2f, 0.9f) : 0;
        const cn_rect rect =
            north ? (cn_rect){ at, row.y0, end, row.y1 - set_back } : (cn_rect){ at, row.y0 + set_back, end, row.y1 };
        const unsigned streets = (north ? 4u : 1u) | (i + 1 == n ? 2u : 0) | (i == 0 ? 8u : 0);
        if (!add_lot(town, rect, seed * 31 + i + 1, streets)) return false;
        at = end;
    }
    return true;
}

static bool add_tree(cn_town *town, float x, float y, float ground, uint32_t seed)
{
    cn_tree *tree = grow(&town->trees, &town->n_trees, &town->room_trees, sizeof *tree);
    if (!tree) return false;
    *tree = (cn_tree){ x,
                       y,
                       ground,
                       cn_town_between(seed, 1, 5, 8.5f),
                       cn_town_between(seed, 2, 1.5f, 2.3f),
                       seed,
                       cn_town_near(town, x, y, 12) };
    return true;
}

static bool add_houses(cn_town *town, const cn_rect *b, uint32_t seed)
{
    const float depth = cn_town_between(seed, 1, 9.5f, 11.5f);
    const cn_rect r = { b->x0 + CN_WALK_M, b->y0 + CN_WALK_M, b->x1 - CN_WALK_M, b->y1 - CN_WALK_M };
    bool good = add_row(town, (cn_rect){ r.x0, r.y0, r.x1, r.y0 + depth }, seed + 1, false) &&
                add_row(town, (cn_rect){ r.x0, r.y1 - depth, r.x1, r.y1 }, seed + 2, true);
    const float low = r.y0 + depth, high = r.y1 - depth;
    /* East and west sides are left open now and then: one looks into the court. */
    if (cn_town_random(seed, 2) < 0.75f)
        good = good && add_lot(town, (cn_rect){ r.x0, low, r.x0 + depth, high }, seed * 31 + 50, 8);
    if (cn_town_random(seed, 3) < 0.75f)
        good = good && add_lot(town, (cn_rect){ r.x1 - depth, low, r.x1, high }, seed * 31 + 51, 2);
    for (uint32_t i = 0; i < 3; i++)
        good = good && add_tree(town, cn_town_between(seed, 4 + i, r.x0 + depth + 2.5f, r.x1 - depth - 2.5f),
                                cn_town_between(seed, 8 + i, low + 2, high - 2), CN_WALK_HEIGHT_M, seed * 7 + i);
    return good;
}

static bool add_park(cn_town *town, const cn_rect *b, uint32_t seed)
{
    const cn_rect r = { b->x0 + CN_WALK_M, b->y0 + CN_WALK_M, b->x1 - CN_WALK_M, b->y1 - CN_WALK_M };
    bool good = true;
    for (uint32_t i = 0; i < 16; i++) {
        const float w = (r.x1 - r.x0) / 4, h = (r.y1 - r.y0) / 4;
        const float x = r.x0 + w * ((float)(i % 4) + cn_town_between(seed, 10 + i, 0.25f, 0.75f));
        const float y = r.y0 + h * ((float)(i / 4) + cn_town_between(seed, 30 + i, 0.25f, 0.75f));
        /* The paths cross in the middle. */
        if (fabsf(x - 0.5f * (r.x0 + r.x1)) < 3 || fabsf(y - 0.5f * (r.y0 + r.y1)) < 3) continue;
        good = good && add_tree(town, x, y, CN_WALK_HEIGHT_M, seed * 7 + i);
    }
    return good;
}

/* One side of a block: where it begins, and which way it goes. */
typedef struct kerb {
    float x, y, dx, dy, length;
} kerb;

/* Trees and lamps by turns along the kerb. */
static bool furnish_side(cn_town *town, kerb k, uint32_t seed)
{
    const uint32_t n = (uint32_t)(k.length / 8.5f);
    bool good = true;
    for (uint32_t i = 0; i < n; i++) {
        const float at = k.length * ((float)i + 0.5f) / (float)n + cn_town_between(seed, i, -0.8f, 0.8f);
        const float px = k.x + k.dx * at, py = k.y + k.dy * at;
        if (i % 2 == 0) {
            cn_lamp *lamp = grow(&town->lamps, &town->n_lamps, &town->room_lamps, sizeof *lamp);
            if (lamp) *lamp = (cn_lamp){ px, py, k.dy, -k.dx };
            good = good && lamp;
        } else if (cn_town_random(seed, 50 + i) < 0.7f) {
            good = good && add_tree(town, px - k.dy * 0.3f, py + k.dx * 0.3f, CN_WALK_HEIGHT_M, seed * 13 + i);
        }
    }
    return good;
}

static bool fill_block(cn_town *town, uint32_t block)
{
    const cn_rect *b = &town->blocks[block];
    const uint32_t seed = town->seed * 1000003u + block * 7919u;
    const float in = 0.55f, w = b->x1 - b->x0, h = b->y1 - b->y0;
    bool good = town->parks[block] ? add_park(town, b, seed) : add_houses(town, b, seed);
    good = good && furnish_side(town, (kerb){ b->x0, b->y0 + in, 1, 0, w }, seed + 11);
    good = good && furnish_side(town, (kerb){ b->x1 - in, b->y0, 0, 1, h }, seed + 12);
    good = good && furnish_side(town, (kerb){ b->x1, b->y1 - in, -1, 0, w }, seed + 13);
    return good && furnish_side(town, (kerb){ b->x0 + in, b->y1, 0, -1, h }, seed + 14);
}

/* Walls that stand against a neighbour as high as themselves or higher have no windows. */
static void find_parties(cn_town *town)
{
    static const float out[4][2] = { { 0, -1 }, { 1, 0 }, { 0, 1 }, { -1, 0 } };
    for (uint32_t i = 0; i < town->n_lots; i++) {
        cn_lot *lot = &town->lots[i];
        const float w = 0.5f * (lot->rect.x1 - lot->rect.x0), h = 0.5f * (lot->rect.y1 - lot->rect.y0);
        for (int side = 0; side < 4; side++) {
            const float x = lot->rect.x0 + w + out[side][0] * (w + 0.5f);
            const float y = lot->rect.y0 + h + out[side][1] * (h + 0.5f);
            for (uint32_t j = 0; j < town->n_lots && !lot->party[side]; j++)
                lot->party[side] = inside(&town->lots[j].rect, x, y, 0);
        }
    }
}

float cn_town_roof(const cn_town *town, float x, float y, float margin)
{
    float roof = 0;
    for (uint32_t i = 0; i < town->n_lots; i++)
        if (inside(&town->lots[i].rect, x, y, margin))
            roof = fmaxf(roof, cn_lot_height(&town->lots[i]) + fmaxf(town->lots[i].gable_m, 1.5f));
    return roof;
}

float cn_town_clearance(const cn_town *town, float x, float y)
{
    float nearest = 1e6f;
    for (uint32_t i = 0; i < town->n_trees; i++)
        nearest = fminf(nearest, hypotf(town->trees[i].x - x, town->trees[i].y - y));
    for (uint32_t i = 0; i < town->n_lamps; i++)
        nearest = fminf(nearest, hypotf(town->lamps[i].x - x, town->lamps[i].y - y));
    return nearest;
}

static bool lay_blocks(cn_town *town)
{
    const float in = CN_ROAD_HALF_M;
    town->n_blocks = (town->n_x - 1) * (town->n_y - 1);
    town->blocks = calloc(town->n_blocks, sizeof *town->blocks);
    town->parks = calloc(town->n_blocks, sizeof *town->parks);
    if (!town->blocks || !town->parks) return false;
    /* One of the four blocks at the centre is a park; of the others, one in ten. */
    const uint32_t pick = (uint32_t)(cn_town_random(town->seed, 7) * 4);
    for (uint32_t i = 0; i < town->n_blocks; i++) {
        const uint32_t ix = i % (town->n_x - 1), iy = i / (town->n_x - 1);
        town->blocks[i] = (cn_rect){ town->x[ix] + in, town->y[iy] + in, town->x[ix + 1] - in, town->y[iy + 1] - in };
        const bool middle =
            ix + 1 >= town->centre_x && ix <= town->centre_x && iy + 1 >= town->centre_y && iy <= town->centre_y;
        const uint32_t corner = (ix == town->centre_x) + 2 * (iy == town->centre_y);
        town->parks[i] = middle ? corner == pick : cn_town_random(town->seed, 1000 + i) < 0.1f;
    }
    return true;
}

cn_status cn_town_init(cn_town *town, const cn_synth_options *options)
{
    memset(town, 0, sizeof *town);
    town->seed = (uint32_t)(cn_rng_u64(options->seed, STREAM_TOWN, 0) >> 34);
    town->half_m = 0.5f * (float)options->size_m;
    const float reach = town->half_m + BACKDROP_M;
    town->n_x = lay_axes(town->seed, reach, town->x, &town->centre_x);
    town->n_y = lay_axes(town->seed + 1, reach, town->y, &town->centre_y);
    bool good = lay_blocks(town);
    for (uint32_t i = 0; i < town->n_blocks && good; i++)
        good = fill_block(town, i);
    if (!good) {
        cn_town_deinit(town);
        return cn_fail(CN_ERR_NOMEM, "out of memory while laying out the city; give a smaller --size");
    }
    find_parties(town);
    return CN_OK;
}

void cn_town_deinit(cn_town *town)
{
    free(town->blocks);
    free(town->parks);
    free(town->lots);
    free(town->trees);
    free(town->lamps);
    memset(town, 0, sizeof *town);
}
