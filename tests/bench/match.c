/* Matches one pair of random descriptors with each instruction set of this machine, on one core: milliseconds of the
 * fastest of some rounds. bench_match [DESCRIPTORS], 8192 when not given. */
#include "base/clock.h"
#include "base/rng.h"
#include "kernel/kernel.h"

#include <stdio.h>
#include <stdlib.h>

int main(int argc, char **argv)
{
    enum { ROUNDS = 7 };
    const uint32_t n = argc > 1 ? (uint32_t)strtoul(argv[1], NULL, 10) : 8192;
    const size_t bytes = (size_t)n * CN_DESCRIPTOR;
    uint8_t *data = malloc(2 * bytes + 1);
    int32_t *found = calloc((size_t)n + 1, 6 * sizeof *found);
    if (!data || !found) return 1;
    for (size_t i = 0; i < 2 * bytes; i++)
        data[i] = (uint8_t)(150 * cn_rng_float(1, 2, i));
    const cn_nearest rows = { found, found + n, found + 2 * (size_t)n };
    const cn_nearest columns = { found + 3 * (size_t)n, found + 4 * (size_t)n, found + 5 * (size_t)n };
    const cn_kernel *sets[4];
    const int n_sets = cn_kernel_sets(sets);
    for (int s = 0; s < n_sets; s++) {
        double best_s = 1e9;
        for (int round = 0; round < ROUNDS && (s || round < 1); round++) {
            const double from_s = cn_now_s();
            sets[s]->match((cn_descriptors){ data, n }, (cn_descriptors){ data + bytes, n }, &rows, &columns);
            const double took_s = cn_now_s() - from_s;
            if (took_s < best_s) best_s = took_s;
        }
        printf("%s: %u x %u descriptors in %.1f ms\n", sets[s]->name, n, n, 1000 * best_s);
    }
    free(data);
    free(found);
    return 0;
}
