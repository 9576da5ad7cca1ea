#include "stage/depth_truth.h"

#include "photo/maps.h"

#include <math.h>
#include <stdlib.h>

#define NEAR_M 0.1f

static cn_status make_room(cn_depth_truth *t, size_t more)
{
    if (t->n + more <= t->room) return CN_OK;
    const size_t room = 2 * (t->n + more);
    float *errors = realloc(t->errors, room * sizeof *errors);
    if (!errors) return cn_fail(CN_ERR_NOMEM, "out of memory for the errors of depth");
    t->errors = errors;
    t->room = room;
    return CN_OK;
}

cn_status cn_depth_truth_add(cn_depth_truth *t, const cn_photo *photo, const cn_picture *picture)
{
    const size_t n = (size_t)picture->width * picture->height;
    cn_photo mapped = *photo;
    mapped.depth = NULL;
    CN_TRY(cn_photo_find_map(t->folder, photo->name, &mapped.depth));
    if (!mapped.depth) return CN_OK;
    float *depth = malloc(n * sizeof *depth);
    cn_status status = depth ? make_room(t, n) : cn_fail(CN_ERR_NOMEM, "out of memory for %s", photo->name);
    if (status == CN_OK) status = cn_photo_read_depth(&mapped, picture->width, picture->height, depth);
    for (size_t i = 0; status == CN_OK && i < n; i++)
        if (depth[i] > 0) t->errors[t->n++] = picture->depth[i] > 0 ? fabsf(picture->depth[i] - depth[i]) : INFINITY;
    free(depth);
    free(mapped.depth);
    return status;
}

static int by_size(const void *a, const void *b)
{
    const float x = *(const float *)a, y = *(const float *)b;
    return (x > y) - (x < y);
}

void cn_depth_truth_summary(cn_depth_truth *t, double *median_m, double *within)
{
    size_t near = 0;
    *median_m = *within = NAN;
    if (!t->n) return;
    qsort(t->errors, t->n, sizeof *t->errors, by_size);
    while (near < t->n && t->errors[near] <= NEAR_M)
        near++;
    *median_m = (double)t->errors[t->n / 2];
    *within = (double)near / (double)t->n;
}

void cn_depth_truth_deinit(cn_depth_truth *t)
{
    free(t->errors);
    *t = (cn_depth_truth){ 0 };
}
