/* Keeps a tile within its budgets of photos and memory, by training on fewer of its photos. */
#include "plan/plan.h"

#include "base/units.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define PLACES 32.0 /* cells along a tile's diameter */
#define HEADINGS 12 /* sectors of the compass */

static int compare_ranked(const void *a, const void *b)
{
    const cn_plan_rank *x = a, *y = b;
    if (x->key != y->key) return x->key < y->key ? -1 : 1;
    return (x->view > y->view) - (x->view < y->view);
}

static int compare_indices(const void *a, const void *b)
{
    uint32_t x = *(const uint32_t *)a, y = *(const uint32_t *)b;
    return (x > y) - (x < y);
}

/* Interleaves the bits of x and y (Morton order), so that near places have near keys. */
static uint32_t interleave(uint32_t x, uint32_t y)
{
    uint32_t key = 0;
    for (uint32_t bit = 0; bit < 8; bit++)
        key |= (x >> bit & 1) << (2 * bit) | (y >> bit & 1) << (2 * bit + 1);
    return key;
}

static uint32_t cell_of(double offset, double radius)
{
    return (uint32_t)fmin(fmax((offset / radius + 1) * PLACES / 2 + PLACES, 0), 3 * PLACES - 1);
}

/* Key of a photo: its position, then its direction. Photos with near keys show nearly the same. Positions are clamped
 * at three radii. */
static uint32_t key_of(const cn_plan_tile *tile, const cn_plan_view *v)
{
    const double heading = atan2(v->forward[1], v->forward[0]) / (2 * CN_PI) + 0.5;
    const uint32_t sector = (uint32_t)fmin(heading * HEADINGS, HEADINGS - 1);
    return interleave(cell_of(v->centre[0] - tile->centre[0], tile->radius_m),
                      cell_of(v->centre[1] - tile->centre[1], tile->radius_m)) *
               HEADINGS +
           sector;
}

cn_status cn_plan_rank_views(const cn_plan_tile *tile, const cn_plan_views *views, const uint32_t *list, uint32_t n,
                             cn_plan_rank **order)
{
    *order = malloc(sizeof **order * (n + 1u));
    if (!*order) return cn_fail(CN_ERR_NOMEM, "out of memory for the %u photos of tile %s", n, tile->id);
    for (uint32_t i = 0; i < n; i++)
        (*order)[i] = (cn_plan_rank){ key_of(tile, &views->views[list[i]]), list[i] };
    qsort(*order, n, sizeof **order, compare_ranked);
    return CN_OK;
}

/* Keeps `keep` of n views: every (n / keep)-th by rank. */
static cn_status thin(const cn_plan_tile *tile, const cn_plan_views *views, uint32_t *list, uint32_t *n, uint32_t keep)
{
    if (keep >= *n) return CN_OK;
    cn_plan_rank *order;
    CN_TRY(cn_plan_rank_views(tile, views, list, *n, &order));
    for (uint32_t i = 0; i < keep; i++)
        list[i] = order[((uint64_t)2 * i + 1) * *n / (2 * (uint64_t)keep)].view;
    qsort(list, keep, sizeof *list, compare_indices);
    free(order);
    *n = keep;
    return CN_OK;
}

/* Held-out photos are thinned in proportion, because they should represent the whole tile. */
static cn_status thin_both(cn_plan_tile *tile, const cn_plan_views *views, uint32_t keep)
{
    const uint32_t held = (uint32_t)ceil((double)tile->n_held_out * keep / tile->n_photos);
    CN_TRY(thin(tile, views, tile->held_out, &tile->n_held_out, held));
    return thin(tile, views, tile->photos, &tile->n_photos, keep);
}

static bool fits(cn_plan_tile *tile, const cn_plan_options *options, uint32_t n_photos)
{
    const uint32_t kept = tile->n_photos;
    tile->n_photos = n_photos;
    options->cost(options->cost_user, tile, &tile->estimate_s, &tile->estimate_bytes);
    tile->n_photos = kept;
    return tile->estimate_bytes <= options->max_tile_bytes;
}

/* Finds by bisection how many photos fit into memory. Only the cost model knows what a photo takes. */
static uint32_t photos_that_fit(cn_plan_tile *tile, const cn_plan_options *options, uint32_t fewest)
{
    uint32_t low = fewest, high = tile->n_photos;
    while (low + 1 < high) {
        const uint32_t middle = low + (high - low) / 2;
        if (fits(tile, options, middle))
            low = middle;
        else
            high = middle;
    }
    return low;
}

cn_status cn_plan_budget_photos(cn_plan_tile *tile, const cn_plan_views *views, const cn_plan_options *options)
{
    if (options->max_tile_photos == 0 || tile->n_photos <= options->max_tile_photos) return CN_OK;
    return thin_both(tile, views, options->max_tile_photos);
}

cn_status cn_plan_budget_bytes(cn_plan_tile *tile, const cn_plan_views *views, const cn_plan_options *options,
                               bool *too_big)
{
    *too_big = false;
    if (!options->cost) return CN_OK;
    const bool good = fits(tile, options, tile->n_photos);
    if (good || options->max_tile_bytes == 0) return CN_OK;
    const uint32_t fewest = tile->n_photos < options->min_photos ? tile->n_photos
                            : options->min_photos > 0            ? options->min_photos
                                                                 : 1;
    *too_big = !fits(tile, options, fewest); /* then fewer photos do not help */
    if (!*too_big) CN_TRY(thin_both(tile, views, photos_that_fit(tile, options, fewest)));
    (void)fits(tile, options, tile->n_photos);
    return CN_OK;
}
