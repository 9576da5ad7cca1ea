/* How well the surface of the tiles fits a reference. */
#include "conurb/stage.h"

#include "base/file.h"
#include "base/json.h"
#include "stage/surface.h"

#include <stdlib.h>

typedef struct geometry_job {
    const cn_context *ctx;
    cn_city *city;
    cn_dataset dataset;
    cn_appearance_spec spec;
    cn_renderer *renderer;
    cn_city_survey survey;
    cn_colour *colour;
} geometry_job;

static json_t *distances_json(const cn_surface_distances *d)
{
    return json_pack("{s:I, s:o, s:o, s:o}", "n", (json_int_t)d->n, "median_m", cn_json_real(d->median_m), "mean_m",
                     cn_json_real(d->mean_m), "within", cn_json_reals(d->within, CN_SURFACE_THRESHOLDS));
}

static cn_status save(const cn_surface_fit *fit, const char *path)
{
    json_t *root = json_pack("{s:b, s:s, s:o, s:o}", "sparse", (int)fit->sparse, "unit", fit->unit, "thresholds_m",
                             cn_json_reals(cn_surface_thresholds_m, CN_SURFACE_THRESHOLDS), "from_reference",
                             distances_json(&fit->from_reference));
    if (!root) return cn_fail(CN_ERR_NOMEM, "%s: out of memory", path);
    if (!fit->sparse) {
        json_object_set_new(root, "from_mesh", distances_json(&fit->from_mesh));
        json_object_set_new(root, "chamfer_m", cn_json_real(fit->chamfer_m));
        json_object_set_new(root, "f_score", cn_json_reals(fit->f_score, CN_SURFACE_THRESHOLDS));
    }
    const cn_status status = cn_json_save(root, path);
    json_decref(root);
    return status;
}

static cn_status make_mesh(geometry_job *j, double cube_m, const char *depths, const char *path)
{
    const cn_pixel_store *pixels;
    CN_TRY(cn_dataset_load(j->ctx, j->city, true, &j->dataset));
    CN_TRY(cn_appearance_spec_parse(&j->spec, NULL, j->city, &j->dataset.photos));
    CN_TRY(cn_renderer_open(&j->renderer, j->ctx, j->city, &j->dataset, "tiles"));
    CN_TRY(cn_renderer_align(j->renderer, j->ctx, &j->spec, true, NULL));
    CN_TRY(cn_city_survey_init(&j->survey, j->city, &j->dataset));
    CN_TRY(cn_city_surface_photos(j->ctx, &j->dataset, depths, &pixels));
    /* Photos are matched as sRGB, as in cn_city_eval: figures depend neither on $OCIO nor on the city's view. */
    CN_TRY(cn_colour_create(&j->colour, ""));
    j->survey.survey.colour = j->colour;
    j->survey.survey.view = j->survey.survey.look = NULL;
    const cn_city_surface surface = {
        .renderer = j->renderer, .survey = &j->survey.survey, .appearance = &j->spec, .cube_m = cube_m, .pixels = pixels
    };
    CN_TRY(cn_folder_of_make(path));
    return cn_city_surface_make(j->ctx, &surface, path);
}

cn_status cn_city_eval_geometry(const cn_context *ctx, cn_city *city, const char *reference, double cube_m,
                                const char *depths, cn_surface_fit *fit)
{
    geometry_job j = { .ctx = ctx, .city = city };
    char *mesh = cn_city_path(city, "eval/mesh.ply"), *json = cn_city_path(city, "eval/geometry.json");
    cn_status status = mesh && json ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory");
    if (status == CN_OK && reference && !cn_file_exists(reference))
        status = cn_fail(CN_ERR_IO, "%s: there is no such file; give a PLY, or the word points", reference);
    if (status == CN_OK) status = make_mesh(&j, cube_m, depths, mesh);
    if (status == CN_OK) status = cn_surface_compare(ctx, mesh, reference, &j.dataset.scene, fit);
    if (status == CN_OK) {
        fit->unit = cn_frame_unit(&j.dataset.frame);
        status = save(fit, json);
    }
    cn_appearance_spec_deinit(&j.spec);
    cn_renderer_destroy(&j.renderer);
    cn_colour_destroy(&j.colour);
    cn_city_survey_deinit(&j.survey);
    cn_dataset_deinit(&j.dataset);
    free(mesh);
    free(json);
    return status;
}
