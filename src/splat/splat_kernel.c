/* Chooses the kernels of splat_tile.h, as kernel/kernel.c does. */
#include "splat/splat_tile.h"

#include <pthread.h>
#include <stdlib.h>
#include <string.h>

enum { MAX_SETS = 3 };

static cn_splat_kernel wide[MAX_SETS];
static const cn_splat_kernel *all[MAX_SETS];
static int n_sets;
static pthread_once_t once = PTHREAD_ONCE_INIT;

static void add(bool (*fill)(cn_splat_kernel *kernel))
{
    if (fill(&wide[n_sets])) {
        all[n_sets] = &wide[n_sets];
        n_sets++;
    }
}

static void choose(void)
{
    all[n_sets++] = &cn_splat_kernel_ref;
#ifdef CN_HAVE_AVX
    add(cn_splat_kernel_fill_avx2);
    add(cn_splat_kernel_fill_avx512);
#elif defined(CN_HAVE_NEON)
    add(cn_splat_kernel_fill_neon);
#else
    (void)add;
#endif
}

int cn_splat_kernels(const cn_splat_kernel *sets[3])
{
    pthread_once(&once, choose);
    for (int i = 0; i < n_sets; i++)
        sets[i] = all[i];
    return n_sets;
}

const cn_splat_kernel *cn_splat_kernel_best(void)
{
    pthread_once(&once, choose);
    const char *wanted = getenv("CONURB_CPU");
    for (int i = 0; wanted && i < n_sets; i++)
        if (strcmp(all[i]->name, wanted) == 0) return all[i];
    return all[n_sets - 1];
}
