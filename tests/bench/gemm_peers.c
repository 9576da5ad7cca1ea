/* The colour head's middle layer (64 x 64 over panels) by Conurb's kernel, by libxsmm and by oneDNN: one thread
 * (OMP_NUM_THREADS=1 for oneDNN), GFLOP/s, median of 15. Built where both libraries are (libxsmm-dev, libdnnl-dev);
 * they are no part of Conurb. libxsmm gets the same panels, and makes code for this shape. oneDNN gets all samples side
 * by side, which suits it best. Neither can apply the ReLU in the same pass, so Conurb does not apply it here either.
 */
#include "field/field.h"

#include <libxsmm.h>
#include <oneapi/dnnl/dnnl.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

enum { WIDTH = 64, PANELS = 64, SAMPLES = PANELS * CN_PANEL, REPEATS = 15, ROUNDS = 20 };

typedef struct work {
    const cn_kernel *kernel;
    libxsmm_smmfunction xsmm;
    float *w, *turned, *x, *y; /* w[in][out], turned[out][in]; x, y[panel][row][lane] */
} work;

static void ours(const work *k)
{
    for (size_t p = 0; p < PANELS; p++)
        k->kernel->gemm((cn_matrix){ k->w, WIDTH, WIDTH }, k->x + p * WIDTH * CN_PANEL, k->y + p * WIDTH * CN_PANEL,
                        NULL, false);
}

/* By columns, as libxsmm counts: y (lanes x out) = x (lanes x in) times v (in x out), v[out][in]: w turned. */
static void by_libxsmm(const work *k)
{
    for (size_t p = 0; p < PANELS; p++)
        k->xsmm(k->x + p * WIDTH * CN_PANEL, k->turned, k->y + p * WIDTH * CN_PANEL);
}

static void by_onednn(const work *k)
{
    dnnl_sgemm('T', 'N', WIDTH, SAMPLES, WIDTH, 1, k->w, WIDTH, k->x, SAMPLES, 0, k->y, SAMPLES);
}

static int by_value(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static double gflops(void (*run)(const work *), const work *k)
{
    double took[REPEATS];
    run(k);
    for (int r = 0; r < REPEATS; r++) {
        struct timespec a, b;
        clock_gettime(CLOCK_THREAD_CPUTIME_ID, &a);
        for (int i = 0; i < ROUNDS; i++)
            run(k);
        clock_gettime(CLOCK_THREAD_CPUTIME_ID, &b);
        took[r] = (double)(b.tv_sec - a.tv_sec) * 1e9 + (double)(b.tv_nsec - a.tv_nsec);
    }
    qsort(took, REPEATS, sizeof *took, by_value);
    return 2.0 * WIDTH * WIDTH * SAMPLES * ROUNDS / took[REPEATS / 2];
}

int main(void)
{
    const size_t n = (size_t)WIDTH * SAMPLES;
    work k = { cn_kernel_best(),
               libxsmm_smmdispatch(CN_PANEL, WIDTH, WIDTH, NULL, NULL, NULL, NULL, &(float){ 0 }, NULL, NULL),
               aligned_alloc(64, WIDTH * WIDTH * sizeof(float)),
               aligned_alloc(64, WIDTH * WIDTH * sizeof(float)),
               aligned_alloc(64, n * sizeof(float)),
               aligned_alloc(64, n * sizeof(float)) };
    if (!k.xsmm || !k.w || !k.turned || !k.x || !k.y) {
        fprintf(stderr, "bench_gemm_peers: %s\n",
                k.xsmm ? "out of memory" : "libxsmm makes no code for this processor");
        return 1;
    }
    for (size_t i = 0; i < WIDTH * WIDTH; i++)
        k.w[i] = (float)(i % 7) / 7 - 0.4f;
    for (size_t i = 0; i < WIDTH; i++)
        for (size_t o = 0; o < WIDTH; o++)
            k.turned[o * WIDTH + i] = k.w[i * WIDTH + o];
    for (size_t i = 0; i < n; i++)
        k.x[i] = (float)(i % 5) / 5 - 0.3f;
    printf("| 64 x 64 over %d samples, one thread | GFLOP/s |\n|---|---|\n", SAMPLES);
    printf("| Conurb, %s | %.1f |\n", k.kernel->name, gflops(ours, &k));
    const float as_ours = k.y[n - 1];
    printf("| libxsmm | %.1f |\n", gflops(by_libxsmm, &k));
    if (fabsf(k.y[n - 1] - as_ours) > 1e-4f)
        fprintf(stderr, "bench_gemm_peers: libxsmm got %g, not %g\n", (double)k.y[n - 1], (double)as_ours);
    printf("| oneDNN | %.1f |\n", gflops(by_onednn, &k));
    free(k.w), free(k.turned), free(k.x), free(k.y);
    return 0;
}
