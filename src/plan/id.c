/* Makes the ids of tiles. */
#include "plan/plan.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static int compare_ids(const void *a, const void *b)
{
    return strcmp(((const cn_plan_tile *)a)->id, ((const cn_plan_tile *)b)->id);
}

static int compare_places(const void *a, const void *b)
{
    const double *x = ((const cn_plan_tile *)a)->centre, *y = ((const cn_plan_tile *)b)->centre;
    for (int k = 0; k < 2; k++)
        if (x[k] != y[k]) return x[k] < y[k] ? -1 : 1;
    return 0;
}

static cn_status name_tiles(cn_plan *plan, const cn_frame *frame, int precision)
{
    for (uint32_t i = 0; i < plan->n_tiles; i++) {
        cn_plan_tile *tile = &plan->tiles[i];
        if (frame->georeferenced) {
            double place[3];
            CN_TRY(cn_frame_to_geodetic(frame, tile->centre, place));
            CN_TRY(cn_geo_mgrs(place[0], place[1], precision, tile->id));
        } else {
            double limit = 99999999; /* beyond this, only the suffix distinguishes tiles */
            long long x = llround(fmax(fmin(tile->centre[0], limit), -limit));
            long long y = llround(fmax(fmin(tile->centre[1], limit), -limit));
            snprintf(tile->id, sizeof tile->id, "L%+05lld%+05lld", x, y);
        }
    }
    qsort(plan->tiles, plan->n_tiles, sizeof *plan->tiles, compare_ids);
    return CN_OK;
}

static bool unique(const cn_plan *plan)
{
    for (uint32_t i = 1; i < plan->n_tiles; i++)
        if (strcmp(plan->tiles[i - 1].id, plan->tiles[i].id) == 0) return false;
    return true;
}

cn_status cn_plan_ids(cn_plan *plan, const cn_frame *frame)
{
    CN_TRY(name_tiles(plan, frame, 4)); /* 10 m */
    if (unique(plan)) return CN_OK;
    if (frame->georeferenced) CN_TRY(name_tiles(plan, frame, 5)); /* 1 m */
    /* Tiles with the same id are numbered from west to east. Ids have the same length otherwise, so an id with "-2"
     * at its end is new. */
    for (uint32_t i = 0, end; i < plan->n_tiles; i = end) {
        for (end = i + 1; end < plan->n_tiles && strcmp(plan->tiles[i].id, plan->tiles[end].id) == 0;)
            end++;
        qsort(plan->tiles + i, end - i, sizeof *plan->tiles, compare_places);
    }
    for (uint32_t i = plan->n_tiles, run; i-- > 1;) {
        for (run = 0; run < i && strcmp(plan->tiles[i - run - 1].id, plan->tiles[i].id) == 0;)
            run++;
        size_t length = strlen(plan->tiles[i].id);
        if (run > 0) snprintf(plan->tiles[i].id + length, sizeof plan->tiles[i].id - length, "-%u", run + 1);
    }
    qsort(plan->tiles, plan->n_tiles, sizeof *plan->tiles, compare_ids);
    return CN_OK;
}

int64_t cn_plan_find(const cn_plan *plan, const char *id)
{
    uint32_t low = 0, high = plan->n_tiles;
    while (low < high) {
        uint32_t middle = low + (high - low) / 2;
        int order = strcmp(plan->tiles[middle].id, id);
        if (order == 0) return middle;
        if (order < 0)
            low = middle + 1;
        else
            high = middle;
    }
    return -1;
}
