/* From views to a mesh: depth maps, then region by region fused distances and their triangles. */
#include "conurb/surface.h"

#include "base/clock.h"
#include "base/file.h"
#include "math/linalg.h"
#include "surface/agreement.h"
#include "surface/mesh_file.h"
#include "surface/nets.h"
#include "surface/refine.h"
#include "surface/textured.h"
#include "surface/tileset.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum {
    LEAST_TRIANGLES = 200,
    CHUNK = 256,
    TILE_CUBES = 128,
    MOST_AT_ONCE = 4000000,
    REGION_CUBES = 512,
    FEWEST_CUBES = 32
};

/* Shares of the time. */
#define RENDERED 0.35
#define REFINED 0.2
#define AGREED 0.05
#define FUSED_FROM (RENDERED + REFINED + AGREED)

typedef struct block_place {
    int32_t at[3], region[2];
} block_place;

typedef struct surface_job {
    const cn_context *ctx;
    const cn_surface_source *source;
    cn_depth_maps maps;
    cn_keys blocks; /* near what a depth map shows */
    block_place *places;
    size_t n_places, room;
    cn_fusion fusion;
    cn_triangles triangles;
    cn_nets nets;
    uint32_t *which; /* maps that reach the region */
    double started, textures_s;
    cn_textured_report textures;
} surface_job;

static void report(const surface_job *j, double done)
{
    const double elapsed = cn_now_s() - j->started;
    const cn_progress_report r = {
        "export", "mesh", done, 1, elapsed, done > 0 ? elapsed / done * (1 - done) : -1, NULL
    };
    cn_progress(j->ctx, &r);
}

/* ---- blocks near the surface ---- */

static bool wanted(const cn_surface_source *source, const double xyz[3])
{
    for (uint32_t i = 0; i < source->n_discs; i++) {
        const cn_surface_disc *d = &source->discs[i];
        if (hypot(xyz[0] - d->centre[0], xyz[1] - d->centre[1]) < d->radius_m) return true;
    }
    return false;
}

static cn_status add_block(surface_job *j, const int32_t at[3])
{
    bool fresh;
    CN_TRY(cn_keys_add(&j->blocks, cn_lattice_key(at), 0, &fresh));
    if (!fresh) return CN_OK;
    if (j->n_places == j->room) {
        const size_t room = j->room ? 2 * j->room : 4096;
        block_place *places = realloc(j->places, room * sizeof *places);
        if (!places) return cn_fail(CN_ERR_NOMEM, "out of memory for %zu blocks of a mesh; give a larger --gsd", room);
        j->places = places;
        j->room = room;
    }
    j->places[j->n_places++] =
        (block_place){ { at[0], at[1], at[2] },
                       { cn_lattice_down(at[0], CN_LATTICE_REGION), cn_lattice_down(at[1], CN_LATTICE_REGION) } };
    return CN_OK;
}

/* All blocks with a lattice point within the band around the place. */
static cn_status add_around(surface_job *j, const double xyz[3])
{
    const double side = CN_LATTICE_SIDE * j->source->cube_m, band = CN_LATTICE_BAND * j->source->cube_m;
    int32_t low[3], high[3];
    for (int k = 0; k < 3; k++) {
        if (!(fabs(xyz[k]) < CN_LATTICE_MOST * j->source->cube_m)) return CN_OK;
        low[k] = (int32_t)floor((xyz[k] - band) / side);
        high[k] = (int32_t)floor((xyz[k] + band) / side);
    }
    for (int32_t z = low[2]; z <= high[2]; z++)
        for (int32_t y = low[1]; y <= high[1]; y++)
            for (int32_t x = low[0]; x <= high[0]; x++)
                CN_TRY(add_block(j, (const int32_t[3]){ x, y, z }));
    return CN_OK;
}

/* Along the ray, as far as the pixel's band reaches. */
static cn_status add_along(surface_job *j, const cn_depth_map *map, const cn_depth_pixel *pixel, const double away[3])
{
    const int more = pixel->band - CN_LATTICE_BAND, steps = (more + CN_LATTICE_SIDE - 1) / CN_LATTICE_SIDE;
    for (int s = -steps; s <= steps; s++) {
        const double depth = (double)pixel->depth_m + (steps ? s * more * j->source->cube_m / steps : 0);
        double xyz[3];
        for (int k = 0; k < 3; k++)
            xyz[k] = map->centre[k] + depth * away[k];
        if (wanted(j->source, xyz)) CN_TRY(add_around(j, xyz));
    }
    return CN_OK;
}

static cn_status add_blocks_of(surface_job *j, const cn_depth_map *map)
{
    const cn_depth_pixel *pixels = j->maps.pixels + map->first;
    const uint32_t width = map->camera.width;
    for (uint32_t i = 0; i < width * map->camera.height; i++) {
        double away[3];
        if (!pixels[i].band || !isfinite(pixels[i].depth_m)) continue;
        if (!cn_depth_map_ray(map, i % width, i / width, away)) continue;
        CN_TRY(add_along(j, map, &pixels[i], away));
    }
    return CN_OK;
}

static cn_status check_stop(const surface_job *j)
{
    return cn_stopping(j->ctx)
               ? cn_fail(CN_ERR_INTERRUPTED, "stopped while making the mesh; run the same command again")
               : CN_OK;
}

static void report_refined(void *user, const cn_progress_report *r)
{
    const surface_job *j = user;
    report(j, RENDERED + REFINED * r->done);
}

static cn_status refine_maps(surface_job *j)
{
    const cn_context ctx = { .progress = report_refined, .user = j, .stop = j->ctx->stop, .pool = j->ctx->pool };
    return cn_depth_maps_refine(&j->maps, &ctx, j->source);
}

static cn_status make_maps(surface_job *j)
{
    const cn_scene *scene = j->source->scene;
    const bool refine = j->source->pixels != NULL;
    const double rendered = refine ? RENDERED : RENDERED + REFINED;
    for (uint32_t i = 0; i < scene->n_views; i++) {
        CN_TRY(check_stop(j));
        CN_TRY(cn_depth_maps_add(&j->maps, j->ctx, j->source, &scene->views[i]));
        report(j, rendered * (i + 1) / scene->n_views);
    }
    CN_TRY(cn_depth_maps_finish(&j->maps, refine));
    if (refine) CN_TRY(refine_maps(j));
    for (uint32_t i = 0; i < j->maps.n; i++) {
        CN_TRY(check_stop(j));
        CN_TRY(cn_depth_maps_agree(&j->maps, j->ctx->pool, i, j->source->cube_m));
        CN_TRY(add_blocks_of(j, &j->maps.maps[i]));
        report(j, RENDERED + REFINED + AGREED * (i + 1) / j->maps.n);
    }
    return CN_OK;
}

/* ---- regions ---- */

static int by_region(const void *a, const void *b)
{
    const block_place *p = a, *q = b;
    const int32_t left[5] = { p->region[1], p->region[0], p->at[2], p->at[1], p->at[0] };
    const int32_t right[5] = { q->region[1], q->region[0], q->at[2], q->at[1], q->at[0] };
    for (int k = 0; k < 5; k++)
        if (left[k] != right[k]) return left[k] < right[k] ? -1 : 1;
    return 0;
}

/* The region's own blocks, and those next to them whose points its last cubes need. */
static cn_status gather_blocks(surface_job *j, size_t first, size_t last)
{
    cn_fusion_clear(&j->fusion);
    for (size_t i = first; i < last; i++)
        CN_TRY(cn_fusion_add(&j->fusion, j->places[i].at, true));
    for (size_t i = first; i < last; i++)
        for (int c = 1; c < 4; c++) {
            int32_t at[3] = { j->places[i].at[0] + (c & 1), j->places[i].at[1] + (c >> 1), j->places[i].at[2] };
            for (int up = 0; up < 2; up++, at[2]++)
                if (cn_keys_find(&j->blocks, cn_lattice_key(at)) != UINT32_MAX)
                    CN_TRY(cn_fusion_add(&j->fusion, at, false)); /* no effect on a block that is there */
        }
    return CN_OK;
}

static void choose_maps(surface_job *j)
{
    const double cube_m = j->source->cube_m, side = CN_LATTICE_SIDE * cube_m;
    double low[3] = { INFINITY, INFINITY, INFINITY }, high[3] = { -INFINITY, -INFINITY, -INFINITY }, centre[3];
    for (uint32_t i = 0; i < j->fusion.n; i++)
        for (int k = 0; k < 3; k++) {
            low[k] = fmin(low[k], side * j->fusion.blocks[i].at[k]);
            high[k] = fmax(high[k], side * (j->fusion.blocks[i].at[k] + 1));
        }
    for (int k = 0; k < 3; k++)
        centre[k] = (low[k] + high[k]) / 2;
    j->fusion.n_which = 0;
    for (uint32_t m = 0; m < j->maps.n; m++)
        if (cn_depth_map_reaches(&j->maps.maps[m], centre, cn_distance3(low, high) / 2, CN_DEPTH_WIDEST * cube_m))
            j->which[j->fusion.n_which++] = m;
    j->fusion.which = j->which;
}

/* The colour of each vertex: the mean of what the maps show there, the nearer ones and those from the front first. */
static void colour_chunk(void *user, size_t chunk, unsigned worker)
{
    surface_job *j = user;
    const double cube_m = j->source->cube_m, band = CN_LATTICE_BAND * cube_m;
    (void)worker;
    for (size_t i = chunk * CHUNK; i < (chunk + 1) * CHUNK && i < j->nets.n; i++) {
        cn_surface_vertex *v = &j->nets.vertices[i];
        const double xyz[3] = { (double)v->xyz[0], (double)v->xyz[1], (double)v->xyz[2] };
        double sum[3] = { 0 }, all = 0, towards[3] = { 0 }, far = 0;
        for (uint32_t w = 0; w < j->fusion.n_which; w++) {
            const cn_depth_map *map = &j->maps.maps[j->which[w]];
            cn_depth_sight sight;
            if (!cn_depth_map_look(&j->maps, map, xyz, &sight) || !(fabs(sight.sight_m) < sight.pixel->band * cube_m))
                continue;
            double facing = 0, dir[3];
            for (int k = 0; k < 3; k++) {
                dir[k] = (map->centre[k] - xyz[k]) / sight.distance_m;
                facing += (double)v->normal[k] * dir[k];
            }
            const double weight = fmax(facing, 0.02) / (sight.distance_m * sight.distance_m);
            for (int k = 0; k < 3; k++) {
                sum[k] += weight * sight.pixel->rgb[k];
                towards[k] += weight * dir[k];
            }
            far += weight * sight.distance_m;
            all += weight;
        }
        if (!cn_normalize3(towards))
            for (int k = 0; k < 3; k++)
                towards[k] = (double)v->normal[k];
        for (int k = 0; k < 3; k++)
            v->eye[k] = (float)(xyz[k] + (all > 0 ? far / all : band) * towards[k]);
        for (int k = 0; k < 3; k++)
            v->rgb[k] = all > 0 ? (uint8_t)lround(sum[k] / all) : 128;
    }
}

static cn_status make_region(surface_job *j, size_t first, size_t last)
{
    CN_TRY(check_stop(j));
    CN_TRY(gather_blocks(j, first, last));
    choose_maps(j);
    cn_fusion_run(&j->fusion);
    CN_TRY(check_stop(j));
    CN_TRY(cn_nets_find(&j->nets, &j->fusion));
    cn_pool_run(j->ctx->pool, (j->nets.n + CHUNK - 1) / CHUNK, colour_chunk, j);
    return cn_nets_add(&j->nets, &j->fusion);
}

static cn_status make_regions(surface_job *j)
{
    if (j->n_places) qsort(j->places, j->n_places, sizeof *j->places, by_region);
    for (size_t first = 0, last; first < j->n_places; first = last) {
        const int32_t *region = j->places[first].region;
        last = first;
        while (last < j->n_places && memcmp(j->places[last].region, region, sizeof j->places[last].region) == 0)
            last++;
        CN_TRY(make_region(j, first, last));
        report(j, FUSED_FROM + (1 - FUSED_FROM) * (double)last / (double)j->n_places);
    }
    return CN_OK;
}

static void report_textures(void *user, double done)
{
    const surface_job *j = user;
    const double elapsed = cn_now_s() - j->textures_s;
    const cn_progress_report r = { "export", "textures", done, 1, elapsed, done > 0 ? elapsed / done * (1 - done) : -1,
                                   NULL };
    cn_progress(j->ctx, &r);
}

static cn_textured textured_of(surface_job *j, const cn_mesh_about *about, double error_m)
{
    const cn_surface_source *s = j->source;
    return (cn_textured){ .ctx = j->ctx,
                          .source = s,
                          .about = about,
                          .texel_m = s->texel_m > 0 ? s->texel_m : s->cube_m,
                          .reach_m = CN_LATTICE_BAND * s->cube_m + error_m,
                          .progress = report_textures,
                          .user = j };
}

/* With fewer triangles, with textures, or both. */
static cn_status write_simple(surface_job *j, cn_mesh *mesh, const cn_mesh_about *about, const char *path)
{
    const cn_surface_source *s = j->source;
    const cn_mesh_wish wish = { s->n_triangles, s->n_triangles ? INFINITY : s->cube_m / 2, s->cube_m / 4,
                                mesh->n_triangles > MOST_AT_ONCE ? REGION_CUBES * s->cube_m : INFINITY };
    double error_m;
    CN_TRY(cn_mesh_simplify(j->ctx, mesh, &wish, &error_m));
    if (s->n_triangles && mesh->n_triangles > s->n_triangles)
        cn_log(j->ctx, CN_LOG_WARN,
               "the mesh keeps %u triangles, more than the %llu asked for: its borders and those of its holes stay as "
               "they are; a larger --gsd gives fewer",
               mesh->n_triangles, (unsigned long long)s->n_triangles);
    if (!s->page_px) return cn_mesh_file_write_mesh(mesh, about, path);
    j->textures_s = cn_now_s();
    cn_textured textured = textured_of(j, about, error_m);
    textured.mesh = mesh;
    return cn_textured_write(&textured, path, &j->textures);
}

static cn_status write_file(surface_job *j, const uint32_t *number, uint64_t n[2], const cn_mesh_about *about,
                            const char *path)
{
    cn_mesh mesh;
    if (!j->source->n_triangles && !j->source->page_px)
        return cn_mesh_file_write(&j->triangles, number, n, about, path);
    CN_TRY(cn_mesh_read(&mesh, &j->triangles, number, n));
    const cn_status status = write_simple(j, &mesh, about, path);
    n[0] = mesh.n_vertices;
    n[1] = mesh.n_triangles;
    cn_mesh_deinit(&mesh);
    return status;
}

/* With textures a leaf is half as wide as one: walls and roofs want texels too. */
static double leaf_side(const surface_job *j)
{
    const cn_surface_source *s = j->source;
    const double half = (s->texel_m > 0 ? s->texel_m : s->cube_m) * s->page_px / 2;
    return s->page_px ? fmin(fmax(half, FEWEST_CUBES * s->cube_m), REGION_CUBES * s->cube_m) : TILE_CUBES * s->cube_m;
}

/* To a file, or as 3D Tiles to a folder. */
static cn_status write_mesh(surface_job *j, const char *path, const char *folder, cn_surface_report *out)
{
    const cn_mesh_about about = { j->source->frame, j->source->appearance, j->source->tiles, j->source->cube_m };
    uint32_t *number = NULL;
    uint64_t n[2];
    CN_TRY(cn_triangles_select(&j->triangles, LEAST_TRIANGLES, &number, n));
    const uint64_t n_dropped = j->triangles.n_triangles - n[1];
    const cn_textured textured = textured_of(j, &about, 0);
    const cn_tileset set = { &j->triangles, number, n, &about, leaf_side(j), j->source->page_px ? &textured : NULL };
    cn_status status = n[1] ? CN_OK
                            : cn_fail(CN_ERR_DATA, "the tiles show no surface that two photos see; train longer, or "
                                                   "look at the renders");
    if (status == CN_OK && !folder) status = cn_frame_save_beside(about.frame, path);
    if (status == CN_OK)
        status = folder ? cn_tileset_write(j->ctx, &set, folder) : write_file(j, number, n, &about, path);
    free(number);
    if (out)
        *out = (cn_surface_report){
            n[0], n[1], n_dropped, j->textures.n_pages, j->textures.n_charts, j->textures.n_texels, j->textures.used
        };
    return status;
}

static cn_status make_surface(surface_job *j, const char *path)
{
    const uint32_t n_views = j->source->scene->n_views;
    j->which = malloc((n_views + (size_t)1) * sizeof *j->which);
    if (!j->which) return cn_fail(CN_ERR_NOMEM, "out of memory for %u depth maps", n_views);
    CN_TRY(cn_depth_maps_open(&j->maps, path, j->source->key, n_views));
    CN_TRY(cn_triangles_open(&j->triangles, path));
    CN_TRY(make_maps(j));
    j->fusion = (cn_fusion){ .ctx = j->ctx,
                             .maps = &j->maps,
                             .cube_m = j->source->cube_m,
                             .measure = j->source->distance,
                             .user = j->source->user };
    j->nets = (cn_nets){ .triangles = &j->triangles, .least_seen = n_views > 1 ? 2 : 1 };
    return make_regions(j);
}

static cn_status export_surface(const cn_context *ctx, const cn_surface_source *source, const char *path,
                                const char *folder, cn_surface_report *out)
{
    static const cn_context nothing = { 0 };
    if (!(source->cube_m > 0 && isfinite(source->cube_m)) || source->width_px < 3)
        return cn_fail(CN_ERR_USAGE, "a mesh of cubes of %g: give a size above 0", source->cube_m);
    if (source->page_px && (source->page_px < 64 || source->page_px > 16384 || !source->shade))
        return cn_fail(CN_ERR_USAGE, "textures of %u texels a side: give 64 to 16384", source->page_px);
    surface_job j = { .ctx = ctx ? ctx : &nothing, .source = source, .started = cn_now_s() };
    cn_status status = make_surface(&j, path);
    if (status == CN_OK) status = write_mesh(&j, path, folder, out);
    cn_nets_deinit(&j.nets);
    cn_fusion_deinit(&j.fusion);
    cn_triangles_close(&j.triangles);
    /* What failed after hours of rendering may be a full disk or a chart: only of wrong data the maps are no use. */
    cn_depth_maps_close(&j.maps, status != CN_OK && status != CN_ERR_DATA);
    cn_keys_deinit(&j.blocks);
    free(j.places);
    free(j.which);
    return status;
}

cn_status cn_surface_export(const cn_context *ctx, const cn_surface_source *source, const char *path,
                            cn_surface_report *out)
{
    CN_TRY(cn_mesh_check_path(path, source->page_px));
    return export_surface(ctx, source, path, NULL, out);
}

cn_status cn_surface_export_tiles(const cn_context *ctx, const cn_surface_source *source, const char *folder,
                                  cn_surface_report *out)
{
    char *scratch = cn_path_join(folder, "tileset.json");
    cn_status status = scratch ? cn_folder_make(folder) : cn_fail(CN_ERR_NOMEM, "out of memory");
    if (status == CN_OK) status = export_surface(ctx, source, scratch, folder, out);
    free(scratch);
    return status;
}
