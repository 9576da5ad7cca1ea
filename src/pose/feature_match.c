#include "pose/feature_match.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

void cn_match_space_deinit(cn_match_space *space)
{
    free(space->nearest);
    free(space->pairs);
    memset(space, 0, sizeof *space);
}

static cn_status make_room(cn_match_space *space, uint32_t n)
{
    if (n <= space->room) return CN_OK;
    cn_match_space_deinit(space);
    space->nearest = malloc(6 * (size_t)n * sizeof *space->nearest);
    space->pairs = malloc(n * sizeof *space->pairs);
    if (!space->nearest || !space->pairs) {
        cn_match_space_deinit(space);
        return cn_fail(CN_ERR_NOMEM, "out of memory matching features");
    }
    space->room = n;
    return CN_OK;
}

static float distance(int32_t product)
{
    return acosf(fminf((float)product * (1.0f / (512.0f * 512.0f)), 1.0f));
}

/* Equal products fail too: their distance is not below the ratio of itself. */
static bool is_distinct(const cn_nearest *nearest, uint32_t i)
{
    if (nearest->index[i] < 0) return false;
    const float best = distance(nearest->best[i]);
    return best <= CN_MATCH_MAX_DISTANCE && best < CN_MATCH_MAX_RATIO * distance(nearest->second[i]);
}

cn_status cn_match_features(const cn_kernel *kernel, cn_descriptors a, cn_descriptors b, cn_match_space *space)
{
    space->n_pairs = 0;
    if (!a.n || !b.n) return CN_OK;
    CN_TRY(make_room(space, a.n > b.n ? a.n : b.n));
    const size_t room = space->room;
    int32_t *at = space->nearest;
    const cn_nearest of_a = { at, at + room, at + 2 * room }, of_b = { at + 3 * room, at + 4 * room, at + 5 * room };
    kernel->match(a, b, &of_a, &of_b);
    for (uint32_t i = 0; i < a.n; i++) {
        const int32_t j = of_a.index[i];
        if (j >= 0 && of_b.index[j] == (int32_t)i && is_distinct(&of_a, i) && is_distinct(&of_b, (uint32_t)j))
            space->pairs[space->n_pairs++] = (cn_feature_pair){ i, (uint32_t)j };
    }
    return CN_OK;
}
