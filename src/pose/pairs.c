/* Chooses the pairs to match. COLMAP's own spatial matcher rounds GPS to 0.01 arc-seconds, so neighbours by GPS are
 * found here. */
#include "pose/pairs.h"

#include "base/file.h"
#include "math/linalg.h"
#include "math/plane.h"
#include "pose/colmap.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define ONE_PLACE_M 0.1
#define BAND_M 20.0                             /* of altitude; bands overlap by half */
enum { NEXT = 9, FAR_FROM = 16, FAR_TO = 512 }; /* COLMAP's sequential_matcher, overlap 10 with quadratic overlap */
enum { BLOCK = 128 };                           /* photos a side of a block of every pair */

typedef struct spot {
    double x, y;
    uint32_t photo;
} spot;

void cn_photo_pairs_deinit(cn_photo_pairs *pairs)
{
    free(pairs->items);
    memset(pairs, 0, sizeof *pairs);
}

bool cn_photo_pairs_add(cn_photo_pairs *pairs, uint32_t a, uint32_t b)
{
    if (pairs->n == pairs->room) {
        const size_t room = pairs->room * 2 + 1024;
        uint64_t *grown = realloc(pairs->items, room * sizeof *grown);
        if (!grown) return false;
        pairs->items = grown;
        pairs->room = room;
    }
    pairs->items[pairs->n++] = a < b ? (uint64_t)a << 32 | b : (uint64_t)b << 32 | a;
    return true;
}

static cn_status no_memory(cn_photo_pairs *pairs)
{
    cn_photo_pairs_deinit(pairs);
    return cn_fail(CN_ERR_NOMEM, "out of memory listing photo pairs");
}

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

static bool find_neighbours(const spot *spots, uint32_t n, uint32_t k, cn_photo_pairs *pairs)
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
            fine = cn_photo_pairs_add(pairs, spots[i].photo, spots[found[j].index].photo);
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

/* Above a busy street all neighbours of a photo from the air are photos of the street, which look elsewhere. So where
 * altitudes differ, each photo also gets neighbours among those of about its altitude. */
static bool find_in_bands(const cn_photo_index *index, const spot *spots, uint32_t n, uint32_t k, cn_photo_pairs *pairs)
{
    double *altitude = malloc((n + (size_t)1) * sizeof *altitude);
    spot *band = malloc((n + (size_t)1) * sizeof *band);
    bool fine = altitude && band;
    uint32_t known = 0;
    for (uint32_t i = 0; i < n && fine; i++)
        if (index->photos[spots[i].photo].has_altitude) altitude[known++] = index->photos[spots[i].photo].altitude_m;
    const double low = known ? cn_select(altitude, known, known / 20) : 0;
    const double high = known ? cn_select(altitude, known, known - 1 - known / 20) : 0;
    const bool apart = high - low > BAND_M;
    for (double at = low - BAND_M / 2; apart && at < high && fine; at += BAND_M / 2) {
        uint32_t m = 0;
        for (uint32_t i = 0; i < n; i++) {
            const cn_photo *photo = &index->photos[spots[i].photo];
            if (photo->has_altitude && photo->altitude_m >= at && photo->altitude_m < at + BAND_M) band[m++] = spots[i];
        }
        if (m > 1) fine = find_neighbours(band, m, k, pairs);
    }
    free(altitude);
    free(band);
    return fine;
}

static const char *photo_name(const void *index, uint32_t photo)
{
    return ((const cn_photo_index *)index)->photos[photo].name;
}

static cn_status find_pairs(const cn_photo_index *index, uint32_t k, spot *spots, cn_photo_pairs *pairs)
{
    uint32_t n;
    bool apart;
    CN_TRY(place_spots(index, spots, &n, &apart));
    if (!apart) return CN_OK;
    qsort(spots, n, sizeof *spots, compare_spots);
    bool fine = find_neighbours(spots, n, k, pairs) && find_in_bands(index, spots, n, k > 1 ? k / 2 : 1, pairs);
    uint32_t *order = cn_path_order(index->n_photos, photo_name, index);
    fine = fine && order;
    for (uint32_t i = 0; i < index->n_photos && fine; i++) {
        if (index->photos[order[i]].has_gps) continue;
        for (uint32_t j = i > k ? i - k : 0; j < index->n_photos && j <= i + k && fine; j++)
            if (j != i) fine = cn_photo_pairs_add(pairs, order[i], order[j]);
    }
    free(order);
    return fine ? CN_OK : no_memory(pairs);
}

void cn_photo_pairs_sort(cn_photo_pairs *pairs)
{
    size_t n = 0;
    if (pairs->n) qsort(pairs->items, pairs->n, sizeof *pairs->items, compare_u64);
    for (size_t i = 0; i < pairs->n; i++)
        if (!i || pairs->items[i] != pairs->items[i - 1]) pairs->items[n++] = pairs->items[i];
    pairs->n = n;
}

cn_status cn_photo_pairs_near(const cn_photo_index *index, uint32_t neighbours, cn_photo_pairs *pairs)
{
    spot *spots = calloc(index->n_photos + (size_t)1, sizeof *spots);
    cn_status status = spots ? find_pairs(index, neighbours > 0 ? neighbours : 1, spots, pairs) : no_memory(pairs);
    if (status == CN_OK) cn_photo_pairs_sort(pairs);
    free(spots);
    return status;
}

cn_status cn_photo_pairs_all(uint32_t n_photos, cn_photo_pairs *pairs)
{
    for (uint32_t i = 0; i < n_photos; i += BLOCK)
        for (uint32_t j = i; j < n_photos; j += BLOCK)
            for (uint32_t a = i; a < i + BLOCK && a < n_photos; a++)
                for (uint32_t b = j > a ? j : a + 1; b < j + BLOCK && b < n_photos; b++)
                    if (!cn_photo_pairs_add(pairs, a, b)) return no_memory(pairs);
    return CN_OK;
}

cn_status cn_photo_pairs_in_sequence(const cn_photo_index *index, cn_photo_pairs *pairs)
{
    uint32_t *order = cn_path_order(index->n_photos, photo_name, index);
    bool fine = order != NULL;
    for (uint32_t a = 0; fine && a < index->n_photos; a++) {
        const uint32_t left = index->n_photos - 1 - a;
        for (uint32_t k = 1; fine && k <= NEXT && k <= left; k++)
            fine = cn_photo_pairs_add(pairs, order[a], order[a + k]);
        for (uint32_t k = FAR_FROM; fine && k <= FAR_TO && k <= left; k *= 2)
            fine = cn_photo_pairs_add(pairs, order[a], order[a + k]);
    }
    free(order);
    return fine ? CN_OK : no_memory(pairs);
}

cn_status cn_photo_pairs_text(const cn_photo_index *index, bool linked, const cn_photo_pairs *pairs, char **text,
                              size_t *size)
{
    *text = NULL;
    *size = 0;
    FILE *stream = open_memstream(text, size);
    bool fine = stream != NULL;
    for (size_t i = 0; i < pairs->n && fine; i++) {
        char *a = cn_colmap_name(index, linked, (uint32_t)(pairs->items[i] >> 32));
        char *b = cn_colmap_name(index, linked, (uint32_t)pairs->items[i]);
        fine = a && b && fprintf(stream, "%s %s\n", a, b) > 0;
        free(a);
        free(b);
    }
    if (stream && fclose(stream) != 0) fine = false;
    if (fine) return CN_OK;
    free(*text);
    *text = NULL;
    return cn_fail(CN_ERR_NOMEM, "out of memory listing photo pairs");
}
