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
