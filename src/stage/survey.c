#include "stage/survey.h"

#include "base/file.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* The tile's file, if it is trained; NULL with CN_OK if not. */
static cn_status tile_path(const cn_city *city, const char *id, char **path)
{
    char relative[128];
    snprintf(relative, sizeof relative, "tiles/%s/DONE", id);
    char *done = cn_city_path(city, relative);
    snprintf(relative, sizeof relative, "tiles/%s/tile.safetensors", id);
    *path = cn_city_path(city, relative);
    const cn_status status = done && *path ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory");
    if (status != CN_OK || !cn_file_exists(done)) {
        free(*path);
        *path = NULL;
    }
    free(done);
    return status;
}

static cn_status add_tiles(cn_city_survey *s, const cn_city *city, const cn_plan *plan)
{
    for (uint32_t i = 0; i < plan->n_tiles; i++) {
        const cn_plan_tile *tile = &plan->tiles[i];
        char *path;
        CN_TRY(tile_path(city, tile->id, &path));
        if (!path) continue;
        s->paths[s->n] = path;
        s->tiles[s->n] = (cn_survey_tile){
            .path = path, .radius_m = tile->radius_m, .views = tile->photos, .n_views = tile->n_photos, .id = tile->id
        };
        memcpy(s->tiles[s->n++].centre, tile->centre, sizeof tile->centre);
    }
    return s->n ? CN_OK
                : cn_fail(CN_ERR_DATA, "%s has no trained tile yet; run `conurb train %s` first", city->folder,
                          city->folder);
}

cn_status cn_city_survey_init(cn_city_survey *s, const cn_city *city, const cn_dataset *dataset)
{
    const cn_plan *plan = &dataset->plan;
    *s = (cn_city_survey){ .tiles = calloc(plan->n_tiles + 1u, sizeof *s->tiles),
                           .paths = calloc(plan->n_tiles + 1u, sizeof *s->paths) };
    cn_status status =
        s->tiles && s->paths ? add_tiles(s, city, plan) : cn_fail(CN_ERR_NOMEM, "out of memory for the list of tiles");
    if (status != CN_OK) {
        cn_city_survey_deinit(s);
        return status;
    }
    s->survey = (cn_survey){ .scene = &dataset->scene,
                             .frame = &dataset->frame,
                             .tiles = s->tiles,
                             .n_tiles = s->n,
                             .width_px = city->config.width_px,
                             .exponent = city->config.compose.exponent,
                             .reach = city->config.compose.reach,
                             .render = cn_render_options_default(),
                             .view = city->config.view,
                             .look = city->config.look,
                             .exposure_ev = city->config.exposure_ev };
    return CN_OK;
}

void cn_city_survey_deinit(cn_city_survey *s)
{
    for (uint32_t i = 0; s->paths && i < s->n; i++)
        free(s->paths[i]);
    free(s->paths);
    free(s->tiles);
    *s = (cn_city_survey){ 0 };
}

cn_status cn_city_heights(void *user, size_t n, const double (*xy_m)[2], double *ground_m)
{
    const cn_city_height_sampler *sounder = user;
    cn_city_survey s;
    CN_TRY(cn_city_survey_init(&s, sounder->city, sounder->dataset));
    const cn_status status = cn_export_heights(sounder->ctx, &s.survey, n, xy_m, ground_m);
    cn_city_survey_deinit(&s);
    return status;
}
