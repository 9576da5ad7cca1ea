#include "pose/connected.h"

#include "base/disjoint.h"
#include "bridge/sqlite.h"
#include "pose/colmap.h"

#include <stdlib.h>

enum { LEAST_PHOTOS = 3 };

/* number: COLMAP's of each photo. */
static cn_status connect(const cn_photo_index *index, const uint32_t *number, const cn_colmap_verified *pairs, size_t n,
                         bool *connected)
{
    uint32_t highest = 0;
    for (uint32_t i = 0; i < index->n_photos; i++)
        highest = number[i] > highest ? number[i] : highest;
    uint32_t *parent = malloc(((size_t)highest + 1) * sizeof *parent),
             *photos = calloc((size_t)highest + 1, sizeof *photos);
    const bool room = parent && photos;
    for (uint32_t k = 0; room && k <= highest; k++)
        parent[k] = k;
    for (size_t p = 0; room && p < n; p++)
        if (pairs[p].a <= highest && pairs[p].b <= highest)
            parent[cn_root_of(parent, pairs[p].a)] = cn_root_of(parent, pairs[p].b);
    for (uint32_t k = 0; room && k <= highest; k++)
        photos[cn_root_of(parent, k)]++;
    for (uint32_t i = 0; room && i < index->n_photos; i++)
        connected[i] = number[i] && photos[cn_root_of(parent, number[i])] >= LEAST_PHOTOS;
    free(parent);
    free(photos);
    return room ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory");
}

static cn_status read(const cn_colmap_job *j, cn_colmap_database *database, bool **connected)
{
    cn_colmap_verified *pairs;
    size_t n;
    CN_TRY(cn_colmap_database_verified(database, &pairs, &n));
    uint32_t *number = calloc(j->index->n_photos + (size_t)1, sizeof *number);
    *connected = n ? malloc(j->index->n_photos + (size_t)1) : NULL;
    cn_status status = number && (*connected || !n) ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory");
    for (uint32_t i = 0; i < j->index->n_photos && status == CN_OK; i++)
        status = cn_colmap_number(database, j->index, j->linked, i, &number[i]);
    if (status == CN_OK && n) status = connect(j->index, number, pairs, n, *connected);
    free(number);
    free(pairs);
    return status;
}

cn_status cn_pose_connected(const cn_colmap_job *j, bool **connected)
{
    cn_colmap_database *database;
    *connected = NULL;
    cn_status status = cn_colmap_database_open(&database, j->database);
    if (status == CN_OK) {
        status = read(j, database, connected);
        cn_colmap_database_close(&database);
    }
    if (status == CN_OK) return CN_OK;
    free(*connected);
    *connected = NULL;
    /* COLMAP says so itself when it cannot read its database. */
    return status == CN_ERR_NOMEM ? status : CN_OK;
}
