/* Why photos have no pose. */
#include "base/file.h"
#include "bridge/oiio.h"
#include "bridge/sqlite.h"
#include "math/linalg.h"
#include "pose/colmap.h"
#include "pose/panorama.h"
#include "pose/quality.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define FEW_FEATURES 0.3  /* of the median photo's */
#define ENOUGH_MATCHES 30 /* verified matches of a pair that a pose can rest on */
#define BLURRED 0.5       /* sharpness beside that of posed photos */
#define MOST_READ 24      /* photos whose pixels are read, at most */
#define REFERENCES 5      /* posed photos to compare with */

/* What COLMAP's database has of each photo of the index. */
typedef struct evidence {
    uint32_t *number, *features;       /* COLMAP's number; 0: it did not read the photo */
    uint32_t *best_posed, *best_other; /* verified matches with the best posed photo, and with the best other one */
    uint32_t *partner;                 /* the photo of best_posed */
    bool *posed, *read, *known;        /* read: by COLMAP, in any database; known: some database tells that */
    uint32_t n;
} evidence;

static bool evidence_init(evidence *e, uint32_t n)
{
    e->n = n;
    e->number = calloc(n + (size_t)1, sizeof *e->number);
    e->features = calloc(n + (size_t)1, sizeof *e->features);
    e->best_posed = calloc(n + (size_t)1, sizeof *e->best_posed);
    e->best_other = calloc(n + (size_t)1, sizeof *e->best_other);
    e->partner = calloc(n + (size_t)1, sizeof *e->partner);
    e->posed = calloc(n + (size_t)1, sizeof *e->posed);
    e->read = calloc(n + (size_t)1, sizeof *e->read);
    e->known = calloc(n + (size_t)1, sizeof *e->known);
    return e->number && e->features && e->best_posed && e->best_other && e->partner && e->posed && e->read && e->known;
}

static void evidence_deinit(evidence *e)
{
    free(e->number);
    free(e->features);
    free(e->best_posed);
    free(e->best_other);
    free(e->partner);
    free(e->posed);
    free(e->read);
    free(e->known);
}

static void take_pair(evidence *e, uint32_t a, uint32_t b, uint32_t n)
{
    uint32_t *best = e->posed[b] ? e->best_posed : e->best_other;
    if (n <= best[a]) return;
    best[a] = n;
    if (e->posed[b]) e->partner[a] = b;
}

/* The photo of COLMAP's number; n when there is none. numbers: sorted by number. */
typedef struct numbered {
    uint32_t number, photo;
} numbered;
static int by_number(const void *a, const void *b)
{
    const numbered *x = a, *y = b;
    return (x->number > y->number) - (x->number < y->number);
}

static int by_photo(const void *a, const void *b)
{
    const uint32_t x = *(const uint32_t *)a, y = *(const uint32_t *)b;
    return (x > y) - (x < y);
}

static void take_pairs(evidence *e, const cn_colmap_verified *pairs, size_t n_pairs)
{
    numbered *list = calloc(e->n + (size_t)1, sizeof *list);
    if (!list) return;
    for (uint32_t i = 0; i < e->n; i++)
        list[i] = (numbered){ e->number[i], i };
    qsort(list, e->n, sizeof *list, by_number);
    for (size_t p = 0; p < n_pairs; p++) {
        const numbered *a = bsearch(&(numbered){ pairs[p].a, 0 }, list, e->n, sizeof *list, by_number);
        const numbered *b = bsearch(&(numbered){ pairs[p].b, 0 }, list, e->n, sizeof *list, by_number);
        if (!a || !b) continue;
        take_pair(e, a->photo, b->photo, pairs[p].n);
        take_pair(e, b->photo, a->photo, pairs[p].n);
    }
    free(list);
}

/* photos: the numbers in the whole index of the photos of `index`; NULL: index is the whole. */
static cn_status read_database(const cn_photo_index *index, const uint32_t *photos, const char *path, evidence *e)
{
    cn_colmap_database *database;
    cn_colmap_verified *pairs = NULL;
    size_t n_pairs = 0;
    const bool linked = cn_colmap_needs_links(index);
    CN_TRY(cn_colmap_database_open(&database, path));
    cn_status status = CN_OK;
    for (uint32_t i = 0; i < index->n_photos && status == CN_OK; i++) {
        const uint32_t p = photos ? photos[i] : i;
        status = cn_colmap_number(database, index, linked, i, &e->number[p]);
        e->read[p] = e->read[p] || e->number[p];
        if (status == CN_OK && e->number[p]) status = cn_colmap_database_count(database, e->number[p], &e->features[p]);
    }
    if (status == CN_OK) status = cn_colmap_database_verified(database, &pairs, &n_pairs);
    if (status == CN_OK) take_pairs(e, pairs, n_pairs);
    for (uint32_t i = 0; i < index->n_photos && status == CN_OK; i++)
        e->known[photos ? photos[i] : i] = true;
    free(pairs);
    cn_colmap_database_close(&database);
    return status;
}

/* The databases of groups whose core has a photo without a pose. Numbers of photos are each database's own. */
static cn_status read_groups(const cn_quality *q, const char *dir, evidence *e)
{
    uint32_t *read = calloc(e->n + (size_t)1, sizeof *read);
    cn_status status = read ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory for the report");
    for (uint32_t g = 0; g < q->grouped->groups.n && status == CN_OK; g++) {
        const cn_photo_group *group = &q->grouped->groups.groups[g];
        uint32_t n_missing = 0;
        for (uint32_t i = 0; i < group->n_core; i++)
            n_missing += !e->posed[group->photos[i]];
        char *path = cn_group_path(dir, g, "database.db");
        cn_photo_index sub = { 0 };
        if (n_missing && path && cn_file_exists(path)) status = cn_group_index(q->index, group, &sub);
        /* That of a group with photos of all directions has their views. */
        if (sub.photos && !cn_panoramas_exist(&sub)) {
            memcpy(read, group->photos, group->n * sizeof *read);
            qsort(read, group->n, sizeof *read, by_photo);
            memset(e->number, 0, e->n * sizeof *e->number);
            /* A database that cannot be read leaves the general reason. */
            (void)!read_database(&sub, read, path, e);
        }
        free(sub.photos);
        free(path);
    }
    free(read);
    return status;
}

static double median_features(const evidence *e)
{
    double *values = malloc((e->n + (size_t)1) * sizeof *values);
    size_t n = 0;
    if (!values) return 0.0;
    for (uint32_t i = 0; i < e->n; i++)
        if (e->posed[i]) values[n++] = e->features[i];
    const double median = n ? cn_select(values, n, n / 2) : 0.0;
    free(values);
    return median;
}

/* Variance of the Laplacian over that of the brightness (Pech-Pacheco et al. 2000): less in a blurred photo, whatever
 * its contrast. NaN: it cannot be read. */
static double sharpness_of(const cn_photo_index *index, uint32_t photo)
{
    char *path = cn_path_join(index->folder, index->photos[photo].name);
    float *rgba = NULL;
    uint32_t w = 0, h = 0;
    double square = 0.0, sum = 0.0, squares = 0.0, n = 0.0;
    if (path && cn_oiio_read_rgba(path, &rgba, &w, &h) == CN_OK)
        for (uint32_t y = 1; y + 1 < h; y++)
            for (uint32_t x = 1; x + 1 < w; x++) {
                const float *g = rgba + 4 * ((size_t)y * w + x) + 1; /* green stands for brightness */
                const double laplacian = 4.0 * g[0] - g[4] - g[-4] - g[4 * (size_t)w] - *(g - 4 * (size_t)w);
                square += laplacian * laplacian;
                sum += g[0];
                squares += (double)g[0] * g[0];
                n++;
            }
    free(rgba);
    free(path);
    const double variance = n > 0.0 ? squares / n - sum / n * (sum / n) : 0.0;
    return variance > 1e-9 ? square / n / variance : NAN;
}

static double reference_sharpness(const cn_quality *q)
{
    double values[REFERENCES];
    size_t n = 0;
    for (uint32_t k = 0; k < REFERENCES && q->scene->n_views; k++) {
        const cn_view *view = &q->scene->views[(uint64_t)k * q->scene->n_views / REFERENCES];
        const double s = view->photo == UINT32_MAX ? NAN : sharpness_of(q->index, view->photo);
        if (isfinite(s)) values[n++] = s;
    }
    return n ? cn_select(values, n, n / 2) : NAN;
}

static void measure_sharpness(cn_quality *q)
{
    const double reference = q->n_missing ? reference_sharpness(q) : NAN;
    for (uint32_t i = 0; i < q->n_missing && i < MOST_READ && isfinite(reference); i++)
        q->missing[i].sharpness = sharpness_of(q->index, q->missing[i].photo) / reference;
}

/* The first reason that fits, in plain words. */
static void explain(const cn_quality *q, const evidence *e, double median, cn_missing_photo *m)
{
    const uint32_t i = m->photo, posed = e->best_posed[i], other = e->best_other[i];
    const bool blurred = m->sharpness < BLURRED;
    m->n_features = e->features[i];
    m->n_verified = posed > other ? posed : other;
    if (e->known[i] && !e->read[i])
        snprintf(m->why, sizeof m->why, "COLMAP did not read it");
    else if (blurred && posed < ENOUGH_MATCHES)
        snprintf(m->why, sizeof m->why, "blurred: its edges are %.0f %% as sharp as those of the others",
                 100.0 * m->sharpness);
    else if (!e->known[i])
        return; /* the general reason stays */
    else if (e->features[i] < FEW_FEATURES * median)
        snprintf(m->why, sizeof m->why, "few features (%u, others %.0f): dark, plain or blurred", e->features[i],
                 median);
    else if (posed >= ENOUGH_MATCHES)
        snprintf(m->why, sizeof m->why, "%u matches with %.80s, but no pose agrees with enough of them", posed,
                 q->index->photos[e->partner[i]].name);
    else if (other >= ENOUGH_MATCHES)
        snprintf(m->why, sizeof m->why,
                 "elsewhere: it matches only photos without a pose (%u matches), a separate part of the collection",
                 other);
    else if (posed)
        snprintf(m->why, sizeof m->why, "too few matches: %u with %.80s, its best partner", posed,
                 q->index->photos[e->partner[i]].name);
    else
        snprintf(m->why, sizeof m->why, "elsewhere: no photo with a pose shows the same");
}

void cn_quality_explain(const cn_quality_task *task, cn_quality *q)
{
    evidence e = { 0 };
    const char *database = task->choice ? task->choice->database : NULL;
    for (uint32_t i = 0; i < q->n_missing; i++)
        snprintf(q->missing[i].why, sizeof q->missing[i].why, "%s",
                 task->choice ? "COLMAP found no pose" : "the imported file has no pose of it");
    const bool grouped = task->groups_dir && q->grouped;
    if (!q->n_missing || (!database && !grouped)) return;
    if (evidence_init(&e, q->index->n_photos)) {
        for (uint32_t i = 0; i < q->scene->n_views; i++)
            if (q->scene->views[i].photo != UINT32_MAX) e.posed[q->scene->views[i].photo] = true;
        if ((grouped ? read_groups(q, task->groups_dir, &e) : read_database(q->index, NULL, database, &e)) == CN_OK) {
            const double median = median_features(&e);
            measure_sharpness(q);
            for (uint32_t i = 0; i < q->n_missing; i++)
                explain(q, &e, median, &q->missing[i]);
        }
    }
    evidence_deinit(&e);
}
