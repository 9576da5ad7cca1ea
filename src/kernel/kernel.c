/* Chooses the kernel set. __builtin_cpu_supports asks both the processor (CPUID) and the operating system (XGETBV). */
#include "kernel/kernel.h"

#include <pthread.h>
#include <stdlib.h>

enum { MAX_SETS = 4 };

static cn_kernel wide_sets[MAX_SETS];
static const cn_kernel *all_sets[MAX_SETS];
static int n_sets;
static const cn_kernel *best, *best_float;
static pthread_once_t once = PTHREAD_ONCE_INIT;

/* Adds a set that starts as the reference, if this processor has it. */
static void add(bool (*fill)(cn_kernel *k))
{
    cn_kernel *k = &wide_sets[n_sets];
    *k = cn_kernel_ref;
    if (fill(k)) all_sets[n_sets++] = k;
}

static void choose(void)
{
    all_sets[n_sets++] = &cn_kernel_ref;
#ifdef CN_HAVE_AVX
    add(cn_kernel_fill_avx2);
    add(cn_kernel_fill_avx512);
    add(cn_kernel_fill_avx512bf16);
#elif defined(CN_HAVE_NEON)
    add(cn_kernel_fill_neon);
#else
    (void)add;
#endif
    best = all_sets[n_sets - 1];
    const char *wanted = getenv("CONURB_CPU");
    for (int i = 0; wanted && i < n_sets; i++)
        if (strcmp(all_sets[i]->name, wanted) == 0) best = all_sets[i];
    best_float = best;
    for (int i = 0; strcmp(best->name, "avx512bf16") == 0 && i < n_sets; i++)
        if (strcmp(all_sets[i]->name, "avx512") == 0) best_float = all_sets[i];
}

const cn_kernel *cn_kernel_best(void)
{
    pthread_once(&once, choose);
    return best;
}

const cn_kernel *cn_kernel_float(void)
{
    pthread_once(&once, choose);
    return best_float;
}

int cn_kernel_sets(const cn_kernel *sets[4])
{
    pthread_once(&once, choose);
    for (int i = 0; i < n_sets; i++)
        sets[i] = all_sets[i];
    return n_sets;
}
