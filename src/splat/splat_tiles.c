#include "splat/splat_tiles.h"

#include "base/clock.h"
#include "base/file.h"
#include "base/json.h"
#include "geo/tile_box.h"
#include "splat/merge.h"
#include "splat/packed.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum {
    MOST = 20000, /* Gaussians of a tile */
    FEWER = 8,    /* times fewer in each level above the octree */
    FEWEST = 300, /* no level has fewer */
    DEEPEST = 24
};
#define LESS 1.25  /* the error of a tile at least, in those of its children */
#define REACH 3.0f /* standard deviations that a box holds */

typedef struct tiler {
    const cn_context *ctx;
    const cn_splats *s;
    const cn_splat_tiles_options *o;
    uint64_t done;
    double started;
} tiler;

/* A cube of the octree and its splats. */
typedef struct node {
    const uint32_t *which;
    size_t n;
    float low[3], side;
    uint32_t depth;
    char name[DEEPEST + 16]; /* "root", then a digit a level */
} node;

static json_t *box_of(const cn_splats *s)
{
    double low[3] = { INFINITY, INFINITY, INFINITY }, high[3] = { -INFINITY, -INFINITY, -INFINITY }, box[12] = { 0 };
    for (size_t i = 0; i < s->n; i++) {
        const double reach = (double)(REACH * fmaxf(fmaxf(s->scale[i][0], s->scale[i][1]), s->scale[i][2]));
        for (int k = 0; k < 3; k++) { /* no fmin and fmax: GCC 12 for ARM breaks on reductions by them */
            const double at = s->origin[k] + (double)s->centre[i][k];
            if (at - reach < low[k]) low[k] = at - reach;
            if (at + reach > high[k]) high[k] = at + reach;
        }
    }
    for (int k = 0; k < 3; k++) {
        box[k] = (low[k] + high[k]) / 2;
        box[3 + 4 * k] = (high[k] - low[k]) / 2;
    }
    return cn_json_reals(box, 12);
}

/* The cube's splats, or `most` at most in their place. *error_m: by how much those are off. Of degree 1 at most. */
static cn_status take(const tiler *t, const node *at, size_t most, cn_splats **out, double *error_m)
{
    double cell_m = 0;
    if (at->n <= most)
        CN_TRY(cn_splats_take(t->s, at->which, at->n, 1, out));
    else
        CN_TRY(cn_splats_merge(t->s, at->which, at->n, most, out, &cell_m));
    for (size_t i = 0; i < (*out)->n && t->s->degree > 1; i++) /* of each row of 27, the first 12 */
        memmove((*out)->colour + 12 * i, (*out)->colour + 27 * i, 12 * sizeof *(*out)->colour);
    if (t->s->degree > 1) (*out)->degree = 1;
    *error_m = sqrt(3) * cell_m;
    return CN_OK;
}

static uint32_t octant_of(const tiler *t, const node *at, uint32_t splat)
{
    uint32_t octant = 0;
    for (int k = 0; k < 3; k++)
        octant |= (t->s->centre[splat][k] >= at->low[k] + at->side / 2 ? 1u : 0u) << k;
    return octant;
}

static cn_status build(tiler *t, const node *at, json_t **json);

/* Sorts the cube's splats by octant and builds each that has some. */
static cn_status build_children(tiler *t, const node *at, json_t *children)
{
    uint32_t *which = malloc(at->n * sizeof *which);
    size_t first[10] = { 0 };
    if (!which) return cn_fail(CN_ERR_NOMEM, "out of memory for a tile of %zu splats", at->n);
    for (size_t i = 0; i < at->n; i++)
        first[octant_of(t, at, at->which[i]) + 2]++;
    for (int c = 2; c < 10; c++)
        first[c] += first[c - 1];
    for (size_t i = 0; i < at->n; i++)
        which[first[octant_of(t, at, at->which[i]) + 1]++] = at->which[i];
    cn_status status = CN_OK;
    for (uint32_t c = 0; c < 8 && status == CN_OK; c++) {
        node child = { .which = which + first[c], .n = first[c + 1] - first[c], .side = at->side / 2 };
        json_t *json = NULL;
        if (!child.n) continue;
        child.depth = at->depth + 1;
        for (int k = 0; k < 3; k++)
            child.low[k] = at->low[k] + (c >> k & 1 ? child.side : 0);
        snprintf(child.name, sizeof child.name, "%.*s%u", DEEPEST + 8, at->name, (unsigned)c);
        status = build(t, &child, &json);
        if (json) json_array_append_new(children, json);
    }
    free(which);
    return status;
}

static void report(tiler *t, size_t n)
{
    t->done += n;
    const double share = (double)t->done / (double)t->s->n, elapsed = cn_now_s() - t->started;
    const cn_progress_report report = { "export", "3D Tiles", share, 1, elapsed, elapsed / share * (1 - share), NULL };
    cn_progress(t->ctx, &report);
}

static cn_status write_tile(const tiler *t, const node *at, const cn_splats *s)
{
    char *name = cn_format("%s.glb", at->name), *path = name ? cn_path_join(t->o->folder, name) : NULL;
    const cn_status status = path ? cn_splat_glb_write(s, &t->o->about, t->o->compressed, path)
                                  : cn_fail(CN_ERR_NOMEM, "out of memory for a tile");
    free(name);
    free(path);
    return status;
}

/* Writes the cube's file, and describes it above its children. Takes the children. */
static cn_status add_tile(const tiler *t, const node *at, size_t most, json_t *children, json_t **json)
{
    char uri[DEEPEST + 24];
    double error_m = 0;
    json_t *child;
    size_t i;
    cn_splats *s = NULL;
    cn_status status = take(t, at, most, &s, &error_m);
    json_array_foreach(children, i, child) error_m =
        fmax(error_m, LESS * json_number_value(json_object_get(child, "geometricError")));
    if (status == CN_OK) status = write_tile(t, at, s);
    snprintf(uri, sizeof uri, "%s.glb", at->name);
    if (status == CN_OK)
        *json = json_pack("{s:{s:o}, s:o, s:s, s:{s:s}}", "boundingVolume", "box", box_of(s), "geometricError",
                          cn_json_real(error_m), "refine", "REPLACE", "content", "uri", uri);
    if (*json && json_array_size(children)) json_object_set(*json, "children", children);
    json_decref(children);
    cn_splats_destroy(&s);
    return status;
}

static cn_status build(tiler *t, const node *at, json_t **json)
{
    if (cn_stopping(t->ctx))
        return cn_fail(CN_ERR_INTERRUPTED, "stopped while writing 3D Tiles; run the same command again");
    const bool leaf = at->n <= MOST || at->depth == DEEPEST;
    json_t *children = json_array();
    const cn_status status = leaf ? CN_OK : build_children(t, at, children);
    if (status != CN_OK) {
        json_decref(children);
        return status;
    }
    CN_TRY(add_tile(t, at, MOST, children, json));
    if (leaf) report(t, at->n);
    return CN_OK;
}

/* Coarser and coarser levels of the whole: viewers leave out a Gaussian that is much smaller than a pixel, so that from
 * afar nothing would be left of the octree's root. */
static cn_status build_far(tiler *t, node *root, json_t **json)
{
    int level = 1;
    for (size_t most = MOST / FEWER; most >= FEWEST; most /= FEWER, level++) {
        if (root->n <= most) continue;
        json_t *children = json_pack("[o]", *json);
        *json = NULL;
        snprintf(root->name, sizeof root->name, "far%d", level);
        CN_TRY(add_tile(t, root, most, children, json));
    }
    return CN_OK;
}

static cn_status save(const tiler *t, json_t *root)
{
    const cn_frame *frame = t->o->about.frame;
    char generator[32];
    double m[16];
    snprintf(generator, sizeof generator, "Conurb %s", cn_version());
    cn_tile_box_widen(root); /* the root's splats are fewer, and may lie less far out than those of a leaf */
    if (frame->georeferenced) {
        cn_frame_ecef(frame, m);
        json_object_set_new(root, "transform", cn_json_reals(m, 16));
    }
    /* The error of drawing nothing: viewers do not even load the root where it is too small to be seen. */
    const double error_m = cn_tile_box_across(root);
    json_t *used = json_pack("[s]", "KHR_gaussian_splatting");
    if (t->o->compressed) json_array_append_new(used, json_string("KHR_gaussian_splatting_compression_spz_2"));
    json_t *json = json_pack("{s:{s:s, s:{s:s, s:s, s:s}}, s:o, s:O, s:[s], s:{s:{s:O}}}", "asset", "version", "1.1",
                             "extras", "generator", generator, "light", t->o->about.light ? t->o->about.light : "mean",
                             "tiles", t->o->about.tiles ? t->o->about.tiles : "", "geometricError",
                             cn_json_real(error_m), "root", root, "extensionsUsed", "3DTILES_content_gltf",
                             "extensions", "3DTILES_content_gltf", "extensionsUsed", used);
    if (json && t->o->compressed)
        json_object_set(json_object_get(json_object_get(json, "extensions"), "3DTILES_content_gltf"),
                        "extensionsRequired", used);
    char *path = cn_path_join(t->o->folder, "tileset.json");
    const cn_status status = json && path ? cn_json_save(json, path) : cn_fail(CN_ERR_NOMEM, "out of memory");
    json_decref(json);
    json_decref(used);
    free(path);
    return status;
}

cn_status cn_splat_tiles_write(const cn_context *ctx, const cn_splats *splats, const cn_splat_tiles_options *options)
{
    tiler t = { .ctx = ctx, .s = splats, .o = options, .started = cn_now_s() };
    json_t *json = NULL;
    node root = { .n = splats->n, .name = "root" };
    if (!splats->n) return cn_fail(CN_ERR_DATA, "%s: there is no splat to write", options->folder);
    CN_TRY(cn_folder_make(options->folder));
    uint32_t *all = malloc(splats->n * sizeof *all);
    if (!all) return cn_fail(CN_ERR_NOMEM, "out of memory for %zu splats", splats->n);
    for (size_t i = 0; i < splats->n; i++)
        all[i] = (uint32_t)i;
    for (int k = 0; k < 3; k++) {
        float high = -INFINITY;
        root.low[k] = INFINITY;
        for (size_t i = 0; i < splats->n; i++) {
            root.low[k] = fminf(root.low[k], splats->centre[i][k]);
            high = fmaxf(high, splats->centre[i][k]);
        }
        root.side = fmaxf(root.side, high - root.low[k]);
    }
    root.which = all;
    cn_status status = build(&t, &root, &json);
    if (status == CN_OK) status = build_far(&t, &root, &json);
    if (status == CN_OK) status = save(&t, json);
    json_decref(json);
    free(all);
    return status;
}
