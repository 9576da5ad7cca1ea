/* Chooses the pairs to match: nearest neighbours by GPS. COLMAP's own spatial matcher rounds GPS to 0.01 arc-seconds.
 */
#include "math/plane.h"
#include "pose/colmap.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define ONE_PLACE_M 0.1

typedef struct spot {
    double x, y;
    uint32_t photo;
} spot;
typedef struct pair_list {
    uint64_t *items;
    size_t n, capacity;
} pair_list;

static int compare_spots(const void *a, const void *b)
{
    const spot *s = a, *t = b;
    if (s->x != t->x) return s->x < t->x ? -1 : 1;
    return (s->photo > t->photo) - (s->photo < t->photo);
}

static int compare_u64(const void *a, const void *b)
{
    uint64_t x = *(const uint64_t *)a, y = *(const uint64_t *)b;
    return (x > y) - (x < y);
}

static bool add(pair_list *list, uint32_t a, uint32_t b)
{
    if (list->n == list->capacity) {
        size_t wanted = list->capacity * 2 + 1024;
        uint64_t *grown = realloc(list->items, wanted * sizeof *grown);
        if (!grown) return false;
        list->items = grown;
        list->capacity = wanted;
    }
    list->items[list->n++] = a < b ? (uint64_t)a << 32 | b : (uint64_t)b << 32 | a;
    return true;
}

static bool find_neighbours(const spot *spots, uint32_t n, uint32_t k, pair_list *list)
{
    double(*places)[2] = calloc(n + (size_t)1, sizeof *places);
    cn_plane_found *found = calloc(k, sizeof *found);
    cn_plane plane = { 0 };
    for (uint32_t i = 0; places && i < n; i++) {
        places[i][0] = spots[i].x;
        places[i][1] = spots[i].y;
    }
    bool fine = places && found && cn_plane_init(&plane, (const double(*)[2])places, NULL, n);
    for (uint32_t i = 0; i < n && fine; i++) {
        const uint32_t n_found = cn_plane_neighbours(&plane, i, k, found);
        for (uint32_t j = 0; j < n_found && fine; j++)
            fine = add(list, spots[i].photo, spots[found[j].index].photo);
    }
    cn_plane_deinit(&plane);
    free(places);
    free(found);
    return fine;
}

static cn_status place_spots(const cn_photo_index *index, spot *spots, uint32_t *n, bool *apart)
{
    cn_frame frame;
    double low[2] = { 0 }, high[2] = { 0 };
    cn_frame_init(&frame);
    *n = 0;
    for (uint32_t i = 0; i < index->n_photos; i++) {
        const cn_photo *photo = &index->photos[i];
        if (!photo->has_gps) continue;
        if (!frame.georeferenced) {
            frame.georeferenced = true;
            frame.latitude_deg = photo->latitude_deg;
            frame.longitude_deg = photo->longitude_deg;
        }
        const double at[3] = { photo->latitude_deg, photo->longitude_deg, 0.0 };
        double local[3];
        CN_TRY(cn_frame_from_geodetic(&frame, at, local));
        spots[(*n)++] = (spot){ local[0], local[1], i };
        for (int k = 0; k < 2; k++) {
            if (local[k] < low[k]) low[k] = local[k];
            if (local[k] > high[k]) high[k] = local[k];
        }
    }
    *apart = high[0] - low[0] > ONE_PLACE_M || high[1] - low[1] > ONE_PLACE_M;
    return CN_OK;
}

static cn_status find_pairs(const cn_photo_index *index, uint32_t k, spot *spots, pair_list *list)
{
    uint32_t n;
    bool apart;
    CN_TRY(place_spots(index, spots, &n, &apart));
    if (!apart) return CN_OK;
    qsort(spots, n, sizeof *spots, compare_spots);
    bool fine = find_neighbours(spots, n, k, list);
    for (uint32_t i = 0; i < index->n_photos && fine; i++) {
        if (index->photos[i].has_gps) continue;
        for (uint32_t j = i > k ? i - k : 0; j < index->n_photos && j <= i + k && fine; j++)
            if (j != i) fine = add(list, i, j);
    }
    return fine ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory listing photo pairs");
}

static cn_status write_pairs(const cn_photo_index *index, bool linked, pair_list *list, char **text, size_t *size,
                             uint64_t *n_pairs)
{
    FILE *stream = open_memstream(text, size);
    if (!stream) return cn_fail(CN_ERR_NOMEM, "out of memory listing photo pairs");
    bool fine = true;
    if (list->n) qsort(list->items, list->n, sizeof *list->items, compare_u64);
    for (size_t i = 0; i < list->n && fine; i++) {
        if (i && list->items[i] == list->items[i - 1]) continue;
        char *a = cn_colmap_name(index, linked, (uint32_t)(list->items[i] >> 32));
        char *b = cn_colmap_name(index, linked, (uint32_t)list->items[i]);
        fine = a && b && fprintf(stream, "%s %s\n", a, b) > 0;
        free(a);
        free(b);
        ++*n_pairs;
    }
    if (fclose(stream) == 0 && fine) return CN_OK;
    free(*text);
    *text = NULL;
    return cn_fail(CN_ERR_NOMEM, "out of memory listing photo pairs");
}

cn_status cn_colmap_pairs(const cn_photo_index *index, bool linked, uint32_t neighbours, char **text, size_t *size,
                          uint64_t *n_pairs)
{
    pair_list list = { 0 };
    uint32_t k = neighbours > 0 ? neighbours : 1;
    spot *spots = calloc(index->n_photos + (size_t)1, sizeof *spots);
    *text = NULL;
    *size = 0;
    *n_pairs = 0;
    cn_status status =
        spots ? find_pairs(index, k, spots, &list) : cn_fail(CN_ERR_NOMEM, "out of memory listing photo pairs");
    if (status == CN_OK) status = write_pairs(index, linked, &list, text, size, n_pairs);
    free(spots);
    free(list.items);
    return status;
}
