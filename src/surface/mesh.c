#include "surface/mesh.h"

#include "math/linalg.h"

#include <math.h>
#include <meshoptimizer.h>
#include <stdlib.h>
#include <string.h>

enum { FEWEST = 12 }; /* indices that are worth simplifying */

void cn_mesh_deinit(cn_mesh *mesh)
{
    free(mesh->vertices);
    free(mesh->corners);
    *mesh = (cn_mesh){ 0 };
}

/* ---- reading ---- */

static cn_status read_kept(cn_mesh *mesh, cn_triangles *triangles, const uint32_t *number)
{
    CN_TRY(cn_triangles_rewind(triangles));
    for (uint32_t i = 0, kept = 0; kept < mesh->n_vertices; i++) {
        CN_TRY(cn_triangles_next_vertex(triangles, &mesh->vertices[kept]));
        kept += number[i] != UINT32_MAX;
    }
    for (uint32_t i = 0; i < mesh->n_triangles;) {
        uint32_t *corner = mesh->corners + 3 * (size_t)i;
        CN_TRY(cn_triangles_next(triangles, corner));
        if (number[corner[0]] == UINT32_MAX) continue;
        for (int k = 0; k < 3; k++)
            corner[k] = number[corner[k]];
        i++;
    }
    return CN_OK;
}

cn_status cn_mesh_read(cn_mesh *mesh, cn_triangles *triangles, const uint32_t *number, const uint64_t n[2])
{
    if (n[1] > UINT32_MAX / 3)
        return cn_fail(CN_ERR_USAGE,
                       "a mesh of %llu triangles is too large to simplify or to texture; give a larger "
                       "--gsd, or 3D Tiles",
                       (unsigned long long)n[1]);
    *mesh = (cn_mesh){ malloc((n[0] + 1) * sizeof *mesh->vertices), malloc((3 * n[1] + 1) * sizeof *mesh->corners),
                       (uint32_t)n[0], (uint32_t)n[1] };
    const cn_status status =
        mesh->vertices && mesh->corners
            ? read_kept(mesh, triangles, number)
            : cn_fail(CN_ERR_NOMEM, "out of memory for %llu vertices; give a larger --gsd", (unsigned long long)n[0]);
    if (status != CN_OK) cn_mesh_deinit(mesh);
    return status;
}

double cn_mesh_normal(const cn_mesh *mesh, uint32_t triangle, double normal[3])
{
    const uint32_t *corner = mesh->corners + 3 * (size_t)triangle;
    double side[2][3];
    for (int s = 0; s < 2; s++)
        for (int k = 0; k < 3; k++)
            side[s][k] = (double)mesh->vertices[corner[s + 1]].xyz[k] - (double)mesh->vertices[corner[0]].xyz[k];
    cn_cross3(side[0], side[1], normal);
    const double twice = cn_norm3(normal);
    if (!cn_normalize3(normal)) normal[2] = 1;
    return twice / 2;
}

/* ---- simplifying ---- */

typedef struct simplifier {
    const cn_context *ctx;
    cn_mesh *mesh;
    const cn_mesh_wish *wish;
    uint64_t *key;   /* of each triangle: its cell, then its number; sorted */
    uint32_t *local; /* of each vertex its number in the cell; UINT32_MAX: none */
    uint32_t *out;   /* corners of the triangles that stay */
    size_t n_out;
    double most_m, moved_m;
} simplifier;

static int by_key(const void *a, const void *b)
{
    const uint64_t x = *(const uint64_t *)a, y = *(const uint64_t *)b;
    return x < y ? -1 : x > y;
}

/* Cells are numbered by 16 bits on each axis of the map; what lies beyond shares a cell. */
static uint64_t cell_of(const simplifier *s, uint32_t triangle, double off)
{
    const uint32_t *corner = s->mesh->corners + 3 * (size_t)triangle;
    uint64_t cell = 0;
    for (int k = 0; k < 2; k++) {
        double at = 0;
        for (int c = 0; c < 3; c++)
            at += (double)s->mesh->vertices[corner[c]].xyz[k] / 3;
        cell = cell << 16 | (uint64_t)fmin(fmax(floor(at / s->wish->cell_m + off) + 32768, 0), 65535);
    }
    return cell;
}

/* The cell's triangles by numbers of its own, and its vertices' places. Returns the number of vertices. */
static uint32_t gather(simplifier *s, const uint64_t *key, size_t n, uint32_t *corners, float (*places)[3],
                       uint32_t *global)
{
    uint32_t n_vertices = 0;
    for (size_t i = 0; i < 3 * n; i++) {
        const uint32_t vertex = s->mesh->corners[3 * (key[i / 3] & UINT32_MAX) + i % 3];
        if (s->local[vertex] == UINT32_MAX) {
            memcpy(places[n_vertices], s->mesh->vertices[vertex].xyz, sizeof *places);
            global[n_vertices] = vertex;
            s->local[vertex] = n_vertices++;
        }
        corners[i] = s->local[vertex];
    }
    for (uint32_t i = 0; i < n_vertices; i++)
        s->local[global[i]] = UINT32_MAX;
    return n_vertices;
}

static cn_status simplify_cell(simplifier *s, const uint64_t *key, size_t n, double share)
{
    uint32_t *corners = malloc((3 * n + 1) * sizeof *corners), *global = malloc((3 * n + 1) * sizeof *global);
    float(*places)[3] = malloc((3 * n + 1) * sizeof *places);
    const bool good = corners && global && places;
    if (good) {
        const uint32_t n_vertices = gather(s, key, n, corners, places, global);
        size_t left = 3 * n;
        const size_t target = (size_t)ceil((double)n * share) * 3;
        if (left >= FEWEST && target < left) {
            float error = 0;
            const float scale = meshopt_simplifyScale(places[0], n_vertices, sizeof *places);
            const double most = fmin(s->most_m / (double)scale, 1e6);
            left = meshopt_simplify(corners, corners, left, places[0], n_vertices, sizeof *places, target, (float)most,
                                    meshopt_SimplifyLockBorder, &error);
            s->moved_m = fmax(s->moved_m, (double)(error * scale));
        }
        for (size_t i = 0; i < left; i++)
            s->out[s->n_out++] = global[corners[i]];
    }
    free(corners);
    free(global);
    free(places);
    return good ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory for a cell of %zu triangles", n);
}

/* One pass over all cells, whose corners are `off` of a cell away from whole multiples. */
static cn_status simplify_cells(simplifier *s, double off)
{
    const uint32_t n = s->mesh->n_triangles;
    const double share = n ? fmin((double)s->wish->triangles / n, 1) : 1;
    const bool cells = isfinite(s->wish->cell_m);
    for (uint32_t i = 0; i < n; i++)
        s->key[i] = (cells ? cell_of(s, i, off) : 0) << 32 | i;
    if (cells && n) qsort(s->key, n, sizeof *s->key, by_key);
    s->n_out = 0;
    for (size_t first = 0, last; first < n; first = last) {
        for (last = first; last < n && s->key[last] >> 32 == s->key[first] >> 32;)
            last++;
        if (cn_stopping(s->ctx))
            return cn_fail(CN_ERR_INTERRUPTED, "stopped while simplifying the mesh; run the same command again");
        CN_TRY(simplify_cell(s, s->key + first, last - first, share));
    }
    memcpy(s->mesh->corners, s->out, s->n_out * sizeof *s->out);
    s->mesh->n_triangles = (uint32_t)(s->n_out / 3);
    return CN_OK;
}

/* Both passes, with an error that doubles until there are few enough triangles. A cell's border stays in a pass:
 * without a limit the rest of the cell would pay for it. */
static cn_status simplify_evenly(simplifier *s, double *error_m)
{
    const cn_mesh_wish *wish = s->wish;
    for (double most_m = fmin(wish->least_m, wish->most_m);; most_m = fmin(2 * most_m, wish->most_m)) {
        s->most_m = most_m;
        for (int pass = 0; pass < 2; pass++) {
            CN_TRY(simplify_cells(s, pass ? 0.5 : 0));
            *error_m += s->moved_m;
            s->moved_m = 0;
        }
        if (s->mesh->n_triangles <= wish->triangles || most_m >= wish->most_m || most_m > wish->cell_m) return CN_OK;
    }
}

/* Removes vertices that no triangle has; the others keep their order. */
static void drop_vertices(simplifier *s)
{
    cn_mesh *m = s->mesh;
    const size_t n = 3 * (size_t)m->n_triangles;
    uint32_t kept = 0;
    for (size_t i = 0; i < n; i++)
        s->local[m->corners[i]] = 0;
    for (uint32_t i = 0; i < m->n_vertices; i++) {
        if (s->local[i] == UINT32_MAX) continue;
        m->vertices[kept] = m->vertices[i];
        s->local[i] = kept++;
    }
    for (size_t i = 0; i < n; i++)
        m->corners[i] = s->local[m->corners[i]];
    m->n_vertices = kept;
}

cn_status cn_mesh_simplify(const cn_context *ctx, cn_mesh *mesh, const cn_mesh_wish *wish, double *error_m)
{
    const size_t n = mesh->n_triangles;
    simplifier s = { .ctx = ctx, .mesh = mesh, .wish = wish, .most_m = wish->most_m };
    s.key = malloc((n + 1) * sizeof *s.key);
    s.local = malloc((mesh->n_vertices + (size_t)1) * sizeof *s.local);
    s.out = malloc((3 * n + 1) * sizeof *s.out);
    cn_status status = s.key && s.local && s.out
                           ? CN_OK
                           : cn_fail(CN_ERR_NOMEM, "out of memory for %zu triangles; give a larger --gsd", n);
    if (s.local) memset(s.local, 0xff, (mesh->n_vertices + (size_t)1) * sizeof *s.local);
    *error_m = 0;
    if (status == CN_OK) status = isfinite(wish->cell_m) ? simplify_evenly(&s, error_m) : simplify_cells(&s, 0);
    *error_m += s.moved_m;
    if (status == CN_OK) drop_vertices(&s);
    free(s.key);
    free(s.local);
    free(s.out);
    return status;
}
