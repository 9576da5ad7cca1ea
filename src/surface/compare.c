/* How well a mesh fits a reference. */
#include "conurb/surface.h"

#include "math/linalg.h"
#include "surface/nearest.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { CHUNK = 1024 };
const double cn_surface_thresholds_m[CN_SURFACE_THRESHOLDS] = { 0.05, 0.1, 0.2, 0.5 };

typedef struct measuring {
    const cn_context *ctx;
    const cn_nearest *to;
    const float (*places)[3];
    size_t n;
    double *distances;
} measuring;

static void measure_chunk(void *user, size_t chunk, unsigned worker)
{
    const measuring *m = user;
    (void)worker;
    if (cn_stopping(m->ctx)) return;
    for (size_t i = chunk * CHUNK; i < (chunk + 1) * CHUNK && i < m->n; i++)
        m->distances[i] = cn_nearest_distance(m->to, m->places[i]);
}

/* The distances of places to the nearest of the list. */
static cn_status measure(const cn_context *ctx, const cn_triangle_list *to, const float (*places)[3], size_t n,
                         cn_surface_distances *out)
{
    cn_nearest nearest;
    measuring m = { ctx, &nearest, places, n, malloc((n + 1) * sizeof *m.distances) };
    if (!m.distances) return cn_fail(CN_ERR_NOMEM, "out of memory for %zu distances", n);
    cn_status status = cn_nearest_init(&nearest, to);
    if (status == CN_OK) {
        cn_pool_run(ctx->pool, (n + CHUNK - 1) / CHUNK, measure_chunk, &m);
        cn_nearest_deinit(&nearest);
        if (cn_stopping(ctx))
            status = cn_fail(CN_ERR_INTERRUPTED, "stopped while measuring; run the same command again");
    }
    *out = (cn_surface_distances){ .n = n, .median_m = NAN, .mean_m = NAN };
    double sum = 0;
    for (size_t i = 0; status == CN_OK && i < n; i++) {
        sum += m.distances[i];
        for (int t = 0; t < CN_SURFACE_THRESHOLDS; t++)
            out->within[t] += m.distances[i] <= cn_surface_thresholds_m[t];
    }
    if (status == CN_OK && n) {
        for (int t = 0; t < CN_SURFACE_THRESHOLDS; t++)
            out->within[t] /= (double)n;
        out->mean_m = sum / (double)n;
        out->median_m = cn_select(m.distances, n, n / 2);
    }
    free(m.distances);
    return status;
}

/* Drops places outside the reference's box, widened by the largest threshold: the reference says nothing of them. */
static uint32_t keep_inside(cn_triangle_list *mesh, const cn_triangle_list *reference)
{
    const float margin = (float)cn_surface_thresholds_m[CN_SURFACE_THRESHOLDS - 1];
    float low[3] = { INFINITY, INFINITY, INFINITY }, high[3] = { -INFINITY, -INFINITY, -INFINITY };
    uint32_t kept = 0;
    for (uint32_t i = 0; i < reference->n_places; i++)
        for (int k = 0; k < 3; k++) {
            low[k] = fminf(low[k], reference->places[i][k] - margin);
            high[k] = fmaxf(high[k], reference->places[i][k] + margin);
        }
    for (uint32_t i = 0; i < mesh->n_places; i++) {
        bool inside = true;
        for (int k = 0; k < 3; k++)
            inside = inside && mesh->places[i][k] >= low[k] && mesh->places[i][k] <= high[k];
        if (inside) memmove(mesh->places[kept++], mesh->places[i], sizeof *mesh->places);
    }
    return kept;
}

static cn_status compare(const cn_context *ctx, cn_triangle_list *mesh, const cn_triangle_list *reference, bool sparse,
                         cn_surface_fit *fit)
{
    CN_TRY(measure(ctx, mesh, (const float(*)[3])reference->places, reference->n_places, &fit->from_reference));
    if (sparse) return CN_OK;
    const uint32_t n = keep_inside(mesh, reference); /* the triangles are not needed any more */
    CN_TRY(measure(ctx, reference, (const float(*)[3])mesh->places, n, &fit->from_mesh));
    fit->chamfer_m = (fit->from_mesh.mean_m + fit->from_reference.mean_m) / 2;
    for (int t = 0; t < CN_SURFACE_THRESHOLDS; t++) {
        const double p = fit->from_mesh.within[t], r = fit->from_reference.within[t];
        fit->f_score[t] = p + r > 0 ? 2 * p * r / (p + r) : 0;
    }
    return CN_OK;
}

static cn_status take_points(const cn_scene *scene, cn_triangle_list *list)
{
    *list = (cn_triangle_list){ .places = malloc((scene->n_points + (size_t)1) * sizeof *list->places) };
    if (!list->places) return cn_fail(CN_ERR_NOMEM, "out of memory for %u points", scene->n_points);
    for (uint32_t i = 0; i < scene->n_points; i++) {
        if (scene->points[i].n_observations < 3) continue;
        for (int k = 0; k < 3; k++)
            list->places[list->n_places][k] = (float)scene->points[i].xyz[k];
        list->n_places++;
    }
    return list->n_places ? CN_OK
                          : cn_fail(CN_ERR_DATA, "the poses have no sparse points that three photos see; give a PLY");
}

cn_status cn_surface_compare(const cn_context *ctx, const char *mesh_path, const char *reference_path,
                             const cn_scene *scene, cn_surface_fit *fit)
{
    static const cn_context nothing = { 0 };
    cn_triangle_list mesh = { 0 }, reference = { 0 };
    *fit = (cn_surface_fit){ .sparse = !reference_path, .chamfer_m = NAN };
    cn_status status = reference_path ? cn_ply_read(&reference, reference_path) : take_points(scene, &reference);
    if (status == CN_OK) status = cn_ply_read(&mesh, mesh_path);
    if (status == CN_OK) status = compare(ctx ? ctx : &nothing, &mesh, &reference, fit->sparse, fit);
    cn_triangle_list_deinit(&mesh);
    cn_triangle_list_deinit(&reference);
    return status;
}
