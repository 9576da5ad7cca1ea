/* A photo through a telescope stands ten or a hundred times as far away as all others. Nothing is known of the way to
 * it, and most of a flight by it would show nothing. */
#include "path/lone.h"

#include "math/linalg.h"

#include <stdlib.h>

/* Times the median distance from the middle. A straight street has 2 at its ends; nine photo sets have 3.4 at most. */
#define APART 5
#define COMPANY 2                /* times that median: views so near to each other keep company ... */
enum { ENOUGH = 3, FEWEST = 4 }; /* ... when they are so many; views of a part that say where its middle is */

typedef struct standing {
    double centre[3], away;
    uint32_t part, view;
} standing;

static int by_part(const void *a, const void *b)
{
    const standing *x = a, *y = b;
    if (x->part != y->part) return x->part < y->part ? -1 : 1;
    return (x->view > y->view) - (x->view < y->view);
}

static bool has_company(const standing *of, uint32_t n, const standing *one, double reach)
{
    uint32_t company = 0;
    for (uint32_t i = 0; i < n && company < ENOUGH; i++)
        company += cn_distance3(of[i].centre, one->centre) <= reach; /* itself is one */
    return company >= ENOUGH;
}

/* The views of one part. scratch: room for n. */
static void mark(standing *of, uint32_t n, double *scratch, bool *lone)
{
    double middle[3];
    if (n < FEWEST) return;
    for (int k = 0; k < 3; k++) {
        for (uint32_t i = 0; i < n; i++)
            scratch[i] = of[i].centre[k];
        middle[k] = cn_select(scratch, n, n / 2);
    }
    for (uint32_t i = 0; i < n; i++)
        scratch[i] = of[i].away = cn_distance3(of[i].centre, middle);
    const double median = cn_select(scratch, n, n / 2);
    for (uint32_t i = 0; i < n && median > 0; i++)
        lone[of[i].view] = of[i].away > APART * median && !has_company(of, n, &of[i], COMPANY * median);
}

cn_status cn_path_find_lone(const cn_scene *scene, const uint32_t *part, bool *lone)
{
    const uint32_t n = scene->n_views;
    standing *of = malloc((n + (size_t)1) * sizeof *of);
    double *scratch = malloc((n + (size_t)1) * sizeof *scratch);
    const bool room = of && scratch;
    for (uint32_t i = 0; room && i < n; i++) {
        of[i] = (standing){ .part = part[i], .view = i };
        cn_view_centre(&scene->views[i], of[i].centre);
    }
    if (room) qsort(of, n, sizeof *of, by_part);
    for (uint32_t i = 0, end; room && i < n; i = end) {
        for (end = i + 1; end < n && of[end].part == of[i].part;)
            end++;
        mark(of + i, end - i, scratch, lone);
    }
    free(of);
    free(scratch);
    return room ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory for the default camera path");
}
