/* Matches the pairs of a list in a COLMAP database, as `conurb poses` does before COLMAP verifies them.
 * bench_pairs DATABASE LIST [THREADS]; LIST: names of two photos a line. Prints pairs and seconds. */
#include "base/clock.h"
#include "pose/pair_matcher.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { MOST_PHOTOS = 100000 };
static cn_photo photos[MOST_PHOTOS];
static cn_photo_index photo_index = { .photos = photos };

static uint32_t photo_of(const char *name)
{
    uint32_t i = 0;
    while (i < photo_index.n_photos && strcmp(photos[i].name, name) != 0)
        i++;
    if (i == photo_index.n_photos && i < MOST_PHOTOS) photos[photo_index.n_photos++].name = strdup(name);
    return i;
}

static cn_status run(const cn_context *ctx, char *database, const cn_photo_pairs *pairs)
{
    cn_colmap_job job = { .ctx = ctx, .index = &photo_index, .database = database };
    cn_job_begin(&job, "matches", (double)pairs->n);
    return cn_pairs_match(&job, pairs);
}

int main(int argc, char **argv)
{
    char a[512], b[512];
    cn_photo_pairs pairs = { 0 };
    cn_context ctx = { 0 };
    FILE *list = argc > 2 ? fopen(argv[2], "r") : NULL;
    if (!list || cn_pool_create(&ctx.pool, argc > 3 ? (unsigned)atoi(argv[3]) : 0) != CN_OK) {
        fprintf(stderr, "usage: bench_pairs DATABASE LIST [THREADS]\n");
        return 2;
    }
    while (fscanf(list, "%511s %511s", a, b) == 2) {
        const uint32_t first = photo_of(a);
        if (!cn_photo_pairs_add(&pairs, first, photo_of(b))) return 7;
    }
    fclose(list);
    const double from_s = cn_now_s();
    const cn_status status = run(&ctx, argv[1], &pairs);
    if (status != CN_OK) {
        fprintf(stderr, "%s\n", cn_error_message());
        return (int)status;
    }
    printf("%zu pairs in %.2f s\n", pairs.n, cn_now_s() - from_s);
    cn_pool_destroy(&ctx.pool);
    cn_photo_pairs_deinit(&pairs);
    for (uint32_t i = 0; i < photo_index.n_photos; i++)
        free(photos[i].name);
    return 0;
}
