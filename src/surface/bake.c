#include "surface/bake.h"

#include "math/linalg.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { BATCH = 1 << 16 };
#define LEAST_ALPHA 0.1f
#define MOVED 0.03 /* of the distance: most moved depths move by less */

typedef struct texture {
    const cn_bake *bake;
    const cn_chart *chart;
    uint32_t side;
    uint8_t *rgb, *full; /* full: 1 where a texel has a colour, 2 where it waits for one */
    cn_status status;
    size_t n; /* texels that wait */
    uint32_t *texel;
    double (*origin)[3], (*direction)[3], (*range)[2];
    float (*rgba)[4];
    uint8_t (*behind)[3]; /* colours of the vertices */
} texture;

/* ---- colours ---- */

/* The photos' place of the vertices, mixed, and through the texel's place. */
static void add_ray(texture *t, uint32_t triangle, const double part[3])
{
    const cn_mesh *m = t->bake->mesh;
    double place[3] = { 0 }, eye[3] = { 0 }, rgb[3] = { 0 };
    for (int c = 0; c < 3; c++) {
        const cn_surface_vertex *v = &m->vertices[m->corners[3 * (size_t)triangle + (size_t)c]];
        for (int k = 0; k < 3; k++) {
            place[k] += part[c] * (double)v->xyz[k];
            eye[k] += part[c] * (double)v->eye[k];
            rgb[k] += part[c] * v->rgb[k];
        }
    }
    double away[3];
    for (int k = 0; k < 3; k++) {
        away[k] = place[k] - eye[k];
        t->behind[t->n][k] = (uint8_t)lround(fmin(fmax(rgb[k], 0), 255));
        t->origin[t->n][k] = eye[k];
    }
    const double distance = cn_norm3(away);
    if (!cn_normalize3(away)) away[2] = -1;
    memcpy(t->direction[t->n], away, sizeof away);
    /* Where a depth was moved to the photos, what the field shows there lies before or behind it. */
    const double reach_m = fmax(t->bake->reach_m, t->bake->source->pixels ? MOVED * distance : 0);
    t->range[t->n][0] = fmax(distance - reach_m, 0);
    t->range[t->n][1] = distance + reach_m;
}

static cn_status shade(texture *t)
{
    const cn_surface_source *s = t->bake->source;
    float *rgba = t->rgba[0];
    const cn_ray_list rays = { t->n, (const double(*)[3])t->origin, (const double(*)[3])t->direction };
    CN_TRY(s->shade(s->user, t->bake->ctx, &rays, (const double(*)[2])t->range, rgba));
    for (size_t i = 0; i < t->n; i++) {
        const float alpha = rgba[4 * i + 3];
        for (size_t k = 0; k < 3; k++)
            rgba[4 * i + k] = alpha > LEAST_ALPHA ? rgba[4 * i + k] / alpha : 0;
    }
    CN_TRY(cn_colour_to_display(s->colour, &s->display, rgba, t->n, 4));
    for (size_t i = 0; i < t->n; i++) {
        uint8_t *to = t->rgb + 3 * (size_t)t->texel[i];
        const bool seen = rgba[4 * i + 3] > LEAST_ALPHA;
        for (size_t k = 0; k < 3; k++)
            to[k] = seen ? (uint8_t)lrintf(fminf(fmaxf(rgba[4 * i + k], 0), 1) * 255) : t->behind[i][k];
        t->full[t->texel[i]] = 1;
    }
    return CN_OK;
}

static void flush(texture *t)
{
    if (t->n && t->status == CN_OK) t->status = shade(t);
    if (t->status == CN_OK && t->bake->progress) t->bake->progress(t->bake->user, t->n);
    t->n = 0;
}

static void visit(void *user, uint32_t triangle, const cn_chart_texel *at)
{
    texture *t = user;
    const size_t texel = (size_t)(t->chart->at_px[1] + at->y) * t->side + t->chart->at_px[0] + at->x;
    if (t->full[texel] || t->status != CN_OK) return;
    t->full[texel] = 2;
    t->texel[t->n] = (uint32_t)texel;
    add_ray(t, triangle, at->part);
    if (++t->n == BATCH) flush(t);
}

/* Centres first: a texel that one triangle covers and another only touches is the first one's. */
typedef struct one_kind {
    texture *texture;
    bool sides;
} one_kind;

static void visit_kind(void *user, uint32_t triangle, const cn_chart_texel *at)
{
    one_kind *k = user;
    if (at->side == k->sides) visit(k->texture, triangle, at);
}

static void bake_chart(texture *t, const cn_chart *chart)
{
    t->chart = chart;
    for (int sides = 0; sides < 2; sides++) {
        one_kind kind = { t, sides == 1 };
        for (uint32_t i = 0; i < chart->n; i++)
            cn_chart_rasterise(t->bake->mesh, chart, t->bake->charts->triangles[chart->first + i], visit_kind, &kind);
    }
}

/* ---- gutters ---- */

/* An empty texel gets the mean of its full neighbours. full: those of this round become 3, so that none counts yet. */
static bool grow_texel(texture *t, uint32_t x, uint32_t y)
{
    unsigned sum[3] = { 0 }, n = 0;
    for (int i = 0; i < 9; i++) {
        const int64_t nx = (int64_t)x + i % 3 - 1, ny = (int64_t)y + i / 3 - 1;
        if (nx < 0 || ny < 0 || nx >= t->side || ny >= t->side) continue;
        const size_t at = (size_t)ny * t->side + (size_t)nx;
        if (t->full[at] != 1) continue;
        for (size_t k = 0; k < 3; k++)
            sum[k] += t->rgb[3 * at + k];
        n++;
    }
    for (size_t k = 0; k < 3 && n; k++)
        t->rgb[3 * ((size_t)y * t->side + x) + k] = (uint8_t)((sum[k] + n / 2) / n);
    return n > 0;
}

static void dilate(texture *t)
{
    const size_t texels = (size_t)t->side * t->side;
    for (int round = 0; round < CN_ATLAS_GUTTER; round++) {
        for (size_t i = 0; i < texels; i++)
            if (!t->full[i] && grow_texel(t, (uint32_t)(i % t->side), (uint32_t)(i / t->side))) t->full[i] = 3;
        for (size_t i = 0; i < texels; i++)
            if (t->full[i] == 3) t->full[i] = 1;
    }
}

/* What no chart is near has the mean colour: smaller copies of the page then keep the charts' colours at their edges,
 * and a JPEG has less to write. */
static void fill_rest(texture *t)
{
    const size_t texels = (size_t)t->side * t->side;
    uint64_t sum[3] = { 0 }, n = 0;
    for (size_t i = 0; i < texels; i++) {
        if (!t->full[i]) continue;
        for (size_t k = 0; k < 3; k++)
            sum[k] += t->rgb[3 * i + k];
        n++;
    }
    for (size_t i = 0; i < texels; i++)
        for (size_t k = 0; k < 3 && !t->full[i] && n; k++)
            t->rgb[3 * i + k] = (uint8_t)(sum[k] / n);
}

/* ---- the page ---- */

static void free_batch(texture *t)
{
    free(t->texel);
    free(t->origin);
    free(t->direction);
    free(t->range);
    free(t->rgba);
    free(t->behind);
    free(t->full);
}

static bool take_batch(texture *t)
{
    const size_t texels = (size_t)t->side * t->side;
    t->rgb = calloc(texels, 3);
    t->full = calloc(texels, 1);
    t->texel = malloc(BATCH * sizeof *t->texel);
    t->origin = malloc(BATCH * sizeof *t->origin);
    t->direction = malloc(BATCH * sizeof *t->direction);
    t->range = malloc(BATCH * sizeof *t->range);
    t->rgba = malloc(BATCH * sizeof *t->rgba);
    t->behind = malloc(BATCH * sizeof *t->behind);
    return t->rgb && t->full && t->texel && t->origin && t->direction && t->range && t->rgba && t->behind;
}

cn_status cn_bake_page(const cn_bake *bake, const cn_atlas_page *page, uint8_t **rgb)
{
    texture t = { .bake = bake, .side = page->side_px };
    if (!take_batch(&t))
        t.status = cn_fail(CN_ERR_NOMEM, "out of memory for a texture of %u texels a side; give smaller pages", t.side);
    for (uint32_t i = 0; i < page->n && t.status == CN_OK; i++)
        bake_chart(&t, &bake->charts->charts[page->first + i]);
    flush(&t);
    if (t.status == CN_OK) {
        dilate(&t);
        fill_rest(&t);
    }
    free_batch(&t);
    if (t.status != CN_OK) {
        free(t.rgb);
        t.rgb = NULL;
    }
    *rgb = t.rgb;
    return t.status;
}
