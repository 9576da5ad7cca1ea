#include "surface/tileset.h"

#include "base/clock.h"
#include "base/file.h"
#include "base/json.h"
#include "geo/tile_box.h"

#include <math.h>
#include <meshoptimizer.h>
#include <stdlib.h>
#include <string.h>

enum { FEWEST = 300 }; /* indices that are worth simplifying */
#define COLOUR_M 6     /* black is so many of the allowed error away from white */
#define TEXELS 8       /* of error: viewers refine at 16 pixels, where a texel then has 2 */

typedef struct tiler {
    const cn_context *ctx;
    const cn_tileset *set;
    const char *folder;
    cn_surface_vertex *vertices;
    uint32_t *corners; /* of all triangles, sorted by leaf */
    uint64_t *first;   /* triangle of each leaf; one more at the end */
    double west, south;
    uint32_t side; /* leaves a side, a power of two */
    int depth;
    uint32_t *local; /* of a vertex its number in the tile that is written; UINT32_MAX: none */
    uint64_t done;   /* triangles of leaves */
    double started;
} tiler;

/* A tile: its triangles by the mesh's vertices, and its JSON. */
typedef struct node {
    uint32_t *corners;
    size_t n; /* indices */
    double error_m;
    json_t *json;
} node;

/* ---- reading ---- */

static uint32_t leaf_of(const tiler *t, const uint32_t corner[3])
{
    double at[2] = { 0 };
    for (int c = 0; c < 3; c++)
        for (int k = 0; k < 2; k++)
            at[k] += (double)t->vertices[corner[c]].xyz[k] / 3;
    const double x = (at[0] - t->west) / t->set->cell_m, y = (at[1] - t->south) / t->set->cell_m;
    const uint32_t i = (uint32_t)fmin(fmax(x, 0), t->side - 1), k = (uint32_t)fmin(fmax(y, 0), t->side - 1);
    return k * t->side + i;
}

static cn_status read_vertices(tiler *t)
{
    const cn_tileset *set = t->set;
    double east = -INFINITY, north = -INFINITY;
    t->west = t->south = INFINITY;
    CN_TRY(cn_triangles_rewind(set->triangles));
    for (uint64_t i = 0, kept = 0; kept < set->n[0]; i++) {
        cn_surface_vertex *v = &t->vertices[kept];
        CN_TRY(cn_triangles_next_vertex(set->triangles, v));
        if (set->number[i] == UINT32_MAX) continue;
        t->west = fmin(t->west, (double)v->xyz[0]);
        t->south = fmin(t->south, (double)v->xyz[1]);
        east = fmax(east, (double)v->xyz[0]);
        north = fmax(north, (double)v->xyz[1]);
        kept++;
    }
    const double span = fmax(east - t->west, north - t->south);
    for (t->side = 1, t->depth = 0; t->side * set->cell_m < span && t->depth < 12; t->side *= 2)
        t->depth++;
    return CN_OK;
}

static cn_status next_triangle(const tiler *t, uint32_t corner[3])
{
    const uint32_t *number = t->set->number;
    do
        CN_TRY(cn_triangles_next(t->set->triangles, corner));
    while (number[corner[0]] == UINT32_MAX);
    for (int k = 0; k < 3; k++)
        corner[k] = number[corner[k]];
    return CN_OK;
}

/* Sorts the triangles by leaf: counts first, then places. */
static cn_status read_triangles(tiler *t)
{
    const uint64_t n = t->set->n[1], leaves = (uint64_t)t->side * t->side;
    t->first = calloc(leaves + 2, sizeof *t->first);
    if (!t->first) return cn_fail(CN_ERR_NOMEM, "out of memory for %llu tiles", (unsigned long long)leaves);
    uint32_t corner[3];
    for (uint64_t i = 0; i < n; i++) {
        CN_TRY(next_triangle(t, corner));
        t->first[leaf_of(t, corner) + 2]++;
    }
    for (uint64_t i = 2; i < leaves + 2; i++)
        t->first[i] += t->first[i - 1];
    CN_TRY(cn_triangles_rewind(t->set->triangles));
    for (uint64_t i = 0; i < n; i++) {
        CN_TRY(next_triangle(t, corner));
        memcpy(t->corners + 3 * t->first[leaf_of(t, corner) + 1]++, corner, sizeof corner);
    }
    return CN_OK;
}

/* ---- one tile ---- */

/* The tile's own vertices, in the order of use; corners become numbers of these. */
static cn_status compact(tiler *t, const node *at, cn_surface_vertex **vertices, uint32_t **corners, uint32_t *n)
{
    *vertices = malloc((at->n + 1) * sizeof **vertices);
    *corners = malloc((at->n + 1) * sizeof **corners);
    *n = 0;
    if (!*vertices || !*corners) return cn_fail(CN_ERR_NOMEM, "out of memory for a tile of %zu triangles", at->n / 3);
    for (size_t i = 0; i < at->n; i++) {
        uint32_t *local = &t->local[at->corners[i]];
        if (*local == UINT32_MAX) {
            *local = *n;
            (*vertices)[(*n)++] = t->vertices[at->corners[i]];
        }
        (*corners)[i] = *local;
    }
    for (size_t i = 0; i < at->n; i++)
        t->local[at->corners[i]] = UINT32_MAX;
    return CN_OK;
}

/* Moves each vertex along its normal by its brightness, so that the simplification sees colours: on flat ground they
 * are all that there is to see. */
static cn_surface_vertex *relief_of(const cn_surface_vertex *vertices, uint32_t n, double height_m)
{
    cn_surface_vertex *relief = malloc((n + (size_t)1) * sizeof *relief);
    for (uint32_t i = 0; relief && i < n; i++) {
        const double grey = (vertices[i].rgb[0] + 2.0 * vertices[i].rgb[1] + vertices[i].rgb[2]) / 1020;
        relief[i] = vertices[i];
        for (int k = 0; k < 3; k++)
            relief[i].xyz[k] += (float)(grey * height_m) * vertices[i].normal[k];
    }
    return relief;
}

/* Leaves `part` of the triangles, where that can be done without moving the border, or the surface and its colours
 * by more than most_m. */
static cn_status simplify(tiler *t, node *at, double part, double most_m)
{
    cn_surface_vertex *vertices = NULL, *relief = NULL;
    uint32_t *corners = NULL, *kept = malloc((at->n + 1) * sizeof *kept), n = 0;
    CN_TRY(kept ? compact(t, at, &vertices, &corners, &n) : cn_fail(CN_ERR_NOMEM, "out of memory for a tile"));
    uint32_t *global = malloc((n + (size_t)1) * sizeof *global);
    relief = relief_of(vertices, n, t->set->textured ? 0 : COLOUR_M * most_m);
    const bool fine = global && relief;
    if (fine && at->n >= FEWEST) {
        float error = 0;
        const float scale = meshopt_simplifyScale(relief[0].xyz, n, sizeof *relief);
        const size_t left = meshopt_simplify(kept, corners, at->n, relief[0].xyz, n, sizeof *relief,
                                             (size_t)((double)at->n / 3 * part) * 3, (float)most_m / scale,
                                             meshopt_SimplifyLockBorder, &error);
        for (size_t i = 0; i < at->n; i++)
            global[corners[i]] = at->corners[i];
        for (size_t i = 0; i < left; i++)
            at->corners[i] = global[kept[i]];
        at->n = left;
        at->error_m += (double)(error * scale);
    }
    free(global);
    free(relief);
    free(vertices);
    free(corners);
    free(kept);
    return fine ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory for a tile of %u vertices", n);
}

static void report(tiler *t)
{
    const double share = (double)t->done / (double)t->set->n[1], elapsed = cn_now_s() - t->started;
    const cn_progress_report r = { "export", "3D Tiles", share,
                                   1,        elapsed,    share > 0 ? elapsed / share * (1 - share) : -1,
                                   NULL };
    cn_progress(t->ctx, &r);
}

static void report_texels(void *user, double done)
{
    (void)done; /* of a tile; the leaves that are done say more */
    report(user);
}

static double texel_of(const tiler *t, uint32_t level)
{
    return t->set->textured->texel_m * (1 << (t->depth - (int)level));
}

static cn_status write_textured(tiler *t, const cn_mesh *mesh, const node *at, uint32_t level, const char *path)
{
    cn_textured textured = *t->set->textured;
    textured.mesh = mesh;
    textured.texel_m = texel_of(t, level);
    textured.reach_m += at->error_m;
    textured.progress = report_texels;
    textured.user = t;
    return cn_textured_write(&textured, path, NULL);
}

/* A box along the axes: its centre and half axes, z up. */
static json_t *box_of(const cn_surface_vertex *vertices, uint32_t n)
{
    double low[3] = { INFINITY, INFINITY, INFINITY }, high[3] = { -INFINITY, -INFINITY, -INFINITY }, box[12] = { 0 };
    for (uint32_t i = 0; i < n; i++)
        for (int k = 0; k < 3; k++) {
            low[k] = fmin(low[k], (double)vertices[i].xyz[k]);
            high[k] = fmax(high[k], (double)vertices[i].xyz[k]);
        }
    for (int k = 0; k < 3; k++) {
        box[k] = (low[k] + high[k]) / 2;
        box[3 + 4 * k] = fmax((high[k] - low[k]) / 2, 1e-3);
    }
    return cn_json_reals(box, 12);
}

static cn_status write_tile(tiler *t, node *at, const uint32_t place[3], json_t *children)
{
    const bool leaf = place[0] == (uint32_t)t->depth; /* there is nothing finer to load */
    const double blur_m = t->set->textured ? TEXELS * texel_of(t, place[0]) : 0;
    char name[64];
    snprintf(name, sizeof name, "%u-%u-%u.glb", place[0], place[1], place[2]);
    char *path = cn_path_join(t->folder, name);
    cn_surface_vertex *vertices = NULL;
    uint32_t *corners = NULL, n = 0;
    cn_status status = path ? compact(t, at, &vertices, &corners, &n) : cn_fail(CN_ERR_NOMEM, "out of memory");
    cn_mesh mesh = { vertices, corners, n, (uint32_t)(at->n / 3) };
    if (status == CN_OK)
        status = t->set->textured ? write_textured(t, &mesh, at, place[0], path)
                                  : cn_mesh_file_write_mesh(&mesh, t->set->about, path);
    if (status == CN_OK)
        at->json =
            json_pack("{s:{s:o}, s:o, s:s, s:{s:s}}", "boundingVolume", "box", box_of(vertices, n), "geometricError",
                      cn_json_real(leaf ? 0 : fmax(at->error_m, blur_m)), "refine", "REPLACE", "content", "uri", name);
    if (at->json && json_array_size(children)) json_object_set(at->json, "children", children);
    free(path);
    free(vertices);
    free(corners);
    return status;
}

/* ---- the tree ---- */

static cn_status take_leaf(tiler *t, const uint32_t place[3], node *out)
{
    const uint64_t leaf = (uint64_t)place[2] * t->side + place[1];
    const uint64_t first = t->first[leaf], last = t->first[leaf + 1];
    out->n = (size_t)(3 * (last - first));
    out->corners = malloc((out->n + 1) * sizeof *out->corners);
    if (!out->corners) return cn_fail(CN_ERR_NOMEM, "out of memory for a tile");
    memcpy(out->corners, t->corners + 3 * first, out->n * sizeof *out->corners);
    t->done += last - first;
    if (last > first) report(t);
    return CN_OK;
}

static cn_status append(node *to, const node *from)
{
    uint32_t *more = realloc(to->corners, (to->n + from->n + 1) * sizeof *more);
    if (!more) return cn_fail(CN_ERR_NOMEM, "out of memory for a tile");
    memcpy(more + to->n, from->corners, from->n * sizeof *more);
    to->corners = more;
    to->n += from->n;
    to->error_m = fmax(to->error_m, from->error_m);
    return CN_OK;
}

/* place: level, x, y. Without triangles there is no JSON. The caller frees the node. */
static cn_status build(tiler *t, const uint32_t place[3], node *out)
{
    *out = (node){ 0 };
    if (cn_stopping(t->ctx))
        return cn_fail(CN_ERR_INTERRUPTED, "stopped while writing 3D Tiles; run the same command again");
    json_t *children = json_array();
    const double cube_m = t->set->about->cube_m;
    cn_status status = CN_OK;
    if (place[0] == (uint32_t)t->depth) status = take_leaf(t, place, out);
    for (uint32_t c = 0; c < 4 && place[0] < (uint32_t)t->depth && status == CN_OK; c++) {
        const uint32_t below[3] = { place[0] + 1, 2 * place[1] + (c & 1), 2 * place[2] + (c >> 1) };
        node child;
        status = build(t, below, &child);
        if (status == CN_OK) status = append(out, &child);
        if (child.json) json_array_append_new(children, child.json);
        free(child.corners);
    }
    if (status == CN_OK && place[0] < (uint32_t)t->depth)
        status = simplify(t, out, 0.25, cube_m * (1 << (t->depth - 1 - (int)place[0])));
    else if (status == CN_OK && t->set->textured)
        status = simplify(t, out, 0, cube_m / 2);
    if (status == CN_OK && out->n) status = write_tile(t, out, place, children);
    json_decref(children);
    return status;
}

static cn_status save_tileset(const tiler *t, node *root)
{
    const cn_mesh_about *about = t->set->about;
    cn_tile_box_widen(root->json); /* simplification may have taken what sticks out of a parent's box */
    /* The error of drawing nothing is the diagonal of the root's box: viewers do not even load the root where it is too
     * small to be seen. */
    const double error_m =
        fmax(cn_tile_box_across(root->json), json_number_value(json_object_get(root->json, "geometricError")));
    char generator[32];
    double m[16];
    snprintf(generator, sizeof generator, "Conurb %s", cn_version());
    if (about->frame->georeferenced) {
        cn_frame_ecef(about->frame, m);
        json_object_set_new(root->json, "transform", cn_json_reals(m, 16));
    }
    json_t *json = json_pack("{s:{s:s, s:{s:s, s:s, s:o}}, s:o, s:O}", "asset", "version", "1.1", "extras", "generator",
                             generator, "light", about->appearance, "cube_m", cn_json_real(about->cube_m),
                             "geometricError", cn_json_real(error_m), "root", root->json);
    char *path = cn_path_join(t->folder, "tileset.json");
    const cn_status status = json && path ? cn_json_save(json, path) : cn_fail(CN_ERR_NOMEM, "out of memory");
    json_decref(json);
    free(path);
    return status;
}

static cn_status make_tiles(tiler *t)
{
    static const uint32_t top[3] = { 0 };
    const uint64_t n_vertices = t->set->n[0];
    t->vertices = malloc((n_vertices + 1) * sizeof *t->vertices);
    t->corners = malloc((3 * t->set->n[1] + 1) * sizeof *t->corners);
    t->local = malloc((n_vertices + 1) * sizeof *t->local);
    if (!t->vertices || !t->corners || !t->local)
        return cn_fail(CN_ERR_NOMEM, "out of memory for %llu vertices; give a larger --gsd",
                       (unsigned long long)n_vertices);
    memset(t->local, 0xff, (n_vertices + 1) * sizeof *t->local);
    CN_TRY(read_vertices(t));
    CN_TRY(read_triangles(t));
    /* The tiles of an earlier set are replaced one by one. Should this one be stopped, no file says that both are one.
     */
    char *old = cn_path_join(t->folder, "tileset.json");
    if (!old) return cn_fail(CN_ERR_NOMEM, "out of memory");
    const cn_status removed = cn_file_remove(old);
    free(old);
    CN_TRY(removed);
    node root;
    cn_status status = build(t, top, &root);
    if (status == CN_OK) status = save_tileset(t, &root);
    json_decref(root.json);
    free(root.corners);
    return status;
}

cn_status cn_tileset_write(const cn_context *ctx, const cn_tileset *set, const char *folder)
{
    tiler t = { .ctx = ctx, .set = set, .folder = folder, .started = cn_now_s() };
    const cn_status status = make_tiles(&t);
    free(t.vertices);
    free(t.corners);
    free(t.first);
    free(t.local);
    return status;
}
