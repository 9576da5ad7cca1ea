#include "stage/surface.h"
#include "base/hash.h"

#include "stage/signed_distance.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* The user of the source's functions. */
typedef struct shown {
    const cn_city_surface *surface;
    cn_city_distance distance;
} shown;

cn_status cn_city_surface_photos(const cn_context *ctx, const cn_dataset *dataset, const char *depths,
                                 const cn_pixel_store **pixels)
{
    const bool field = depths && strcmp(depths, "field") == 0;
    *pixels = field ? NULL : dataset->pixels;
    if (!field && depths && strcmp(depths, "stereo") != 0)
        return cn_fail(CN_ERR_USAGE, "depths '%s': give stereo or field", depths);
    if (!field && !dataset->pixels)
        cn_log(
            ctx, CN_LOG_WARN,
            "the mesh's depths are as the tiles show them, for the photos' pixels are not there; `conurb plan` makes "
            "them");
    return CN_OK;
}

static cn_status draw(void *user, const cn_context *ctx, const cn_camera *camera, const cn_view *view,
                      cn_picture *picture)
{
    const cn_city_surface *s = ((const shown *)user)->surface;
    cn_render_options options = s->survey->render;
    /* The expected depth, by which the meshes in tests/bench/README.md were measured. By the median a made city's mesh
     * is the same within 0.1 %; castle and herz-jesus were not measured. */
    options.depth_left = 0;
    const cn_tile_cache_view what = {
        .camera = camera, .view = view, .options = &options, .appearance = s->appearance
    };
    return cn_renderer_draw(s->renderer, ctx, &what, CN_RENDERER_BLEND, picture);
}

static cn_status shade(void *user, const cn_context *ctx, const cn_ray_list *rays, const double (*range_m)[2],
                       float *rgba)
{
    const cn_city_surface *s = ((const shown *)user)->surface;
    const cn_renderer_light light = { &s->survey->render, s->appearance, range_m };
    return cn_renderer_shade(s->renderer, ctx, &light, rays, rgba);
}

static void distance(void *user, unsigned worker, size_t n, const double (*xyz)[3], float *distance_m)
{
    const shown *of = user;
    cn_city_distance_at(&of->distance, worker, n, xyz, distance_m);
}

/* "3: ID ID ID"; of very many the first ones. */
static void list_tiles(const cn_survey *survey, char *out, size_t size)
{
    size_t used = (size_t)snprintf(out, size, "%u:", survey->n_tiles);
    for (uint32_t i = 0; i < survey->n_tiles && survey->tiles[i].id; i++) {
        const char *id = used + strlen(survey->tiles[i].id) + 8 > size ? "..." : survey->tiles[i].id;
        used += (size_t)snprintf(out + used, size - used, " %s", id);
        if (id != survey->tiles[i].id) return;
    }
}

/* What depth maps are made of: tiles, views, light, and how they are shown. Not 0. */
static cn_status key_of(const cn_city_surface *surface, const char *light, uint32_t width_px, uint64_t *key)
{
    const cn_survey *s = surface->survey;
    char *yaml = cn_city_path(surface->renderer->city, "city.yaml");
    cn_status status = yaml ? cn_hash_file(yaml, key) : cn_fail(CN_ERR_NOMEM, "out of memory");
    free(yaml);
    for (uint32_t i = 0; status == CN_OK && i < s->n_tiles; i++) {
        uint64_t tile;
        status = cn_hash_file(s->tiles[i].path, &tile);
        *key = cn_hash_text(*key, "%llx", (unsigned long long)tile);
    }
    for (uint32_t i = 0; status == CN_OK && i < s->scene->n_views; i++) {
        const cn_view *v = &s->scene->views[i];
        const cn_camera *c = &s->scene->cameras[v->camera];
        *key = cn_hash_text(*key, "%llx %llx %llx", (unsigned long long)cn_hash64(v->rotation, sizeof v->rotation),
                            (unsigned long long)cn_hash64(v->translation, sizeof v->translation),
                            (unsigned long long)cn_hash64(c->params, sizeof c->params));
    }
    CN_TRY(status);
    *key = cn_hash_text(*key, "%s %s %u %s %s %a %d", cn_version(), light, width_px, s->view ? s->view : "",
                        s->look ? s->look : "", s->exposure_ev, surface->pixels != NULL) |
           1;
    return CN_OK;
}

/* The caller frees them. NULL: out of memory. */
static cn_surface_disc *discs_of(const cn_survey *survey)
{
    cn_surface_disc *discs = calloc(survey->n_tiles + (size_t)1, sizeof *discs);
    for (uint32_t i = 0; discs && i < survey->n_tiles; i++) {
        memcpy(discs[i].centre, survey->tiles[i].centre, sizeof discs[i].centre);
        discs[i].radius_m = survey->reach * survey->tiles[i].radius_m;
    }
    return discs;
}

cn_status cn_city_surface_make(const cn_context *ctx, const cn_city_surface *surface, const char *path)
{
    const cn_survey *survey = surface->survey;
    shown mine = { .surface = surface };
    const double gsd_m = cn_export_gsd(survey);
    char light[640], tiles[1024];
    cn_surface_report report;
    cn_surface_disc *discs = discs_of(survey);
    if (!discs) return cn_fail(CN_ERR_NOMEM, "out of memory for %u tiles", survey->n_tiles);
    cn_status status = cn_city_distance_init(&mine.distance, ctx, survey);
    cn_appearance_spec_describe(surface->appearance, light, sizeof light);
    list_tiles(survey, tiles, sizeof tiles);
    const double cube_m = surface->cube_m > 0 ? surface->cube_m : gsd_m;
    /* Depth maps as fine as the cubes. */
    const double width = fmax(32, fmin(round(survey->width_px * gsd_m / cube_m), 4.0 * survey->width_px));
    uint64_t key = 0;
    if (status == CN_OK) status = key_of(surface, light, (uint32_t)width, &key);
    const cn_surface_source source = { .scene = survey->scene,
                                       .frame = survey->frame,
                                       .draw = draw,
                                       .pixels = surface->pixels,
                                       .distance = mine.distance.any ? distance : NULL,
                                       .user = &mine,
                                       .discs = discs,
                                       .n_discs = survey->n_tiles,
                                       .width_px = (uint32_t)width,
                                       .cube_m = cube_m,
                                       .colour = survey->colour,
                                       .display = { survey->view, survey->look, survey->exposure_ev },
                                       .appearance = light,
                                       .tiles = tiles,
                                       .key = key,
                                       .n_triangles = surface->n_triangles,
                                       .page_px = surface->page_px,
                                       .texel_m = surface->texel_m,
                                       .shade = shade };
    if (status == CN_OK)
        status = surface->tiles ? cn_surface_export_tiles(ctx, &source, path, &report)
                                : cn_surface_export(ctx, &source, path, &report);
    cn_city_distance_deinit(&mine.distance);
    free(discs);
    CN_TRY(status);
    cn_log(ctx, CN_LOG_INFO, "%s: %llu vertices, %llu triangles, cubes of %g %s, light %s: %s",
           surface->tiles ? "3D Tiles" : "mesh", (unsigned long long)report.n_vertices,
           (unsigned long long)report.n_triangles, cube_m, cn_frame_unit(survey->frame), light, path);
    if (report.n_textures)
        cn_log(ctx, CN_LOG_INFO, "textures: %u of %g %s a texel, %u charts, %.1f million texels, %.0f %% of them used",
               report.n_textures, surface->texel_m > 0 ? surface->texel_m : cube_m, cn_frame_unit(survey->frame),
               report.n_charts, (double)report.n_texels / 1e6, 100 * report.used);
    return CN_OK;
}
