/* Groups photos that share a lens: same camera, same size, same focal length. */
#include "pose/colmap.h"

#include "bridge/sqlite.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define MOST_GROUPS 64 /* each needs a run of COLMAP; photos of smaller groups get a camera each */

typedef struct group_key {
    const char *camera;
    uint32_t width, height; /* as stored */
    double focal_mm;        /* -1 if absent */
    uint32_t photo;
    double focal_px; /* 0: not known exactly */
} group_key;

static int compare_lens(const group_key *a, const group_key *b)
{
    int order = strcmp(a->camera, b->camera);
    if (!order) order = (a->width > b->width) - (a->width < b->width);
    if (!order) order = (a->height > b->height) - (a->height < b->height);
    if (!order) order = (a->focal_mm > b->focal_mm) - (a->focal_mm < b->focal_mm);
    return order;
}

static int compare_keys(const void *a, const void *b)
{
    const group_key *x = a, *y = b;
    int order = compare_lens(x, y);
    return order ? order : (x->photo > y->photo) - (x->photo < y->photo);
}

static int compare_groups(const void *a, const void *b)
{
    const cn_lens_group *x = a, *y = b;
    if (x->n != y->n) return x->n < y->n ? 1 : -1;
    return (x->first > y->first) - (x->first < y->first);
}

void cn_lens_groups_deinit(cn_lens_groups *groups)
{
    free(groups->order);
    free(groups->groups);
    memset(groups, 0, sizeof *groups);
}

static group_key key_of(const cn_photo *photo, uint32_t i)
{
    bool turned = photo->orientation >= 5 && photo->orientation <= 8;
    return (group_key){ photo->camera ? photo->camera : "",
                        turned ? photo->height : photo->width,
                        turned ? photo->width : photo->height,
                        isfinite(photo->focal_mm) ? photo->focal_mm : -1.0,
                        i,
                        photo->focal_px };
}

/* Photos without a camera name share a lens only when all photos of the collection agree. A lens that is known is
 * shared always. */
static bool may_share(const group_key *key, uint32_t n, uint32_t n_photos, bool share)
{
    if (key->focal_px > 0.0) return true;
    return share && n > 1 && (key->camera[0] || n == n_photos);
}

/* The largest groups share lenses; all other photos go into one last group with a camera each. */
static void arrange(cn_lens_groups *out, const group_key *keys, uint32_t n, bool share)
{
    cn_lens_group *found = out->groups;
    uint32_t n_found = 0, n_shared, at = 0;
    for (uint32_t i = 0, j; i < n; i = j) {
        for (j = i + 1; j < n && compare_lens(&keys[i], &keys[j]) == 0;)
            j++;
        if (may_share(&keys[i], j - i, n, share))
            found[n_found++] = (cn_lens_group){ i, j - i, true, keys[i].focal_px };
    }
    if (n_found) qsort(found, n_found, sizeof *found, compare_groups);
    n_shared = n_found < MOST_GROUPS ? n_found : MOST_GROUPS;
    bool *taken = (bool *)(found + n + 1); /* room behind the groups, see cn_colmap_group */
    for (uint32_t g = 0; g < n_shared; g++) {
        uint32_t first = found[g].first;
        found[g].first = at;
        for (uint32_t i = 0; i < found[g].n; i++) {
            out->order[at++] = keys[first + i].photo;
            taken[first + i] = true;
        }
    }
    cn_lens_group rest = { at, n - at, false, 0.0 };
    for (uint32_t i = 0; i < n; i++)
        if (!taken[i]) out->order[at++] = keys[i].photo;
    out->n_groups = n_shared;
    if (rest.n) found[out->n_groups++] = rest;
}

cn_status cn_colmap_group(const cn_photo_index *index, bool share, cn_lens_groups *out)
{
    uint32_t n = index->n_photos;
    group_key *keys = calloc(n + (size_t)1, sizeof *keys);
    out->order = calloc(n + (size_t)1, sizeof *out->order);
    out->groups = calloc(n + (size_t)1, sizeof *out->groups + sizeof(bool));
    out->n_groups = 0;
    if (!keys || !out->order || !out->groups) {
        free(keys);
        cn_lens_groups_deinit(out);
        return cn_fail(CN_ERR_NOMEM, "out of memory grouping %u photos", n);
    }
    for (uint32_t i = 0; i < n; i++)
        keys[i] = key_of(&index->photos[i], i);
    qsort(keys, n, sizeof *keys, compare_keys);
    arrange(out, keys, n, share);
    free(keys);
    return CN_OK;
}

/* The camera of the first photo of a group that is in the database. */
static cn_status camera_of(const cn_photo_index *index, bool linked, cn_colmap_database *database,
                           const uint32_t *photos, uint32_t n, uint32_t *camera)
{
    *camera = 0;
    for (uint32_t i = 0; i < n && !*camera; i++) {
        char *name = cn_colmap_name(index, linked, photos[i]);
        const cn_status status = name ? cn_colmap_database_camera(database, name, camera)
                                      : cn_fail(CN_ERR_NOMEM, "out of memory looking for photos");
        free(name);
        CN_TRY(status);
    }
    return CN_OK;
}

cn_status cn_colmap_find_cameras(const cn_photo_index *index, bool linked, const cn_lens_groups *groups,
                                 const char *path, uint32_t *cameras)
{
    cn_colmap_database *database;
    CN_TRY(cn_colmap_database_open(&database, path));
    cn_status status = CN_OK;
    for (uint32_t i = 0; i < groups->n_groups && status == CN_OK; i++) {
        const cn_lens_group *group = &groups->groups[i];
        cameras[i] = 0;
        if (group->shared)
            status = camera_of(index, linked, database, groups->order + group->first, group->n, &cameras[i]);
    }
    cn_colmap_database_close(&database);
    return status;
}
