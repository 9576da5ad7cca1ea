#include "effect/runs.h"

#include <math.h>
#include <stdlib.h>

#define RUN_GAP_S 1800.0f

float cn_run_time(const cn_photo *photo)
{
    return (float)(photo->time_s - 1.5e9);
}

static int by_value(const void *a, const void *b)
{
    const float x = *(const float *)a, y = *(const float *)b;
    return (x > y) - (x < y);
}

uint32_t cn_runs_find(float *times, size_t stride, uint32_t n)
{
    float *sorted = malloc(sizeof *sorted * (n + (size_t)1));
    uint32_t known = 0, runs = 1;
    for (uint32_t i = 0; sorted && i < n; i++)
        if (isfinite(times[i * stride])) sorted[known++] = times[i * stride];
    if (sorted) qsort(sorted, known, sizeof *sorted, by_value);
    for (uint32_t k = 1; k < known; k++)
        runs += sorted[k] - sorted[k - 1] > RUN_GAP_S;
    for (uint32_t i = 0; i < n; i++) {
        uint32_t run = isfinite(times[i * stride]);
        for (uint32_t k = 1; run && k < known && sorted[k] <= times[i * stride]; k++)
            run += sorted[k] - sorted[k - 1] > RUN_GAP_S;
        times[i * stride] = (float)run;
    }
    free(sorted);
    return runs;
}

/* The trained photo nearest in time, within the gap that ends a run; -1: none. */
static int64_t nearest_trained(const float *times, size_t stride, uint32_t n_trained, float time)
{
    int64_t nearest = -1;
    float least = RUN_GAP_S;
    for (uint32_t k = 0; k < n_trained; k++) {
        const float gap = fabsf(times[k * stride] - time);
        if (gap <= least) nearest = k, least = gap;
    }
    return nearest;
}

uint32_t cn_runs_find_trained(float *times, size_t stride, uint32_t n, uint32_t n_trained)
{
    int64_t *like = malloc(sizeof *like * (n - n_trained + (size_t)1));
    for (uint32_t i = n_trained; like && i < n; i++)
        like[i - n_trained] = nearest_trained(times, stride, n_trained, times[i * stride]);
    const uint32_t runs = cn_runs_find(times, stride, n_trained);
    for (uint32_t i = n_trained; i < n; i++) {
        const int64_t trained = like ? like[i - n_trained] : -1;
        if (trained >= 0)
            times[i * stride] = times[(size_t)trained * stride];
        else
            times[i * stride] = isfinite(times[i * stride]) ? -1 : 0;
    }
    free(like);
    return runs;
}

bool cn_runs_differ(const float *run, uint32_t n)
{
    for (uint32_t i = 0; i < n; i++)
        if (run[i] > 1) return true;
    return false;
}

void cn_runs_draw(const float *run, uint32_t n, float *rows, size_t stride, uint32_t width, float part)
{
    enum { AT_ONCE = 256 }; /* runs; among photos of many strangers each photo is its own run */
    float runs = 0;
    for (uint32_t i = 0; i < n; i++)
        runs = fmaxf(runs, run[i]);
    for (float first = 1; first <= runs; first += AT_ONCE)
        for (uint32_t c = 0; c < width; c++) {
            double sum[AT_ONCE] = { 0 };
            uint32_t count[AT_ONCE] = { 0 };
            for (uint32_t i = 0; i < n; i++) {
                const float r = run[i] - first;
                if (r >= 0 && r < AT_ONCE) sum[(int)r] += (double)rows[i * stride + c], count[(int)r]++;
            }
            for (uint32_t i = 0; i < n; i++) {
                const float r = run[i] - first;
                if (r >= 0 && r < AT_ONCE)
                    rows[i * stride + c] += part * ((float)(sum[(int)r] / count[(int)r]) - rows[i * stride + c]);
            }
        }
}
