#include "../common.h"
#include "../field/options.h"
#include "town.h"

#include "base/file.h"
#include "field/occupancy.h"
#include "math/linalg.h"
#include "tile/model.h"

#include <math.h>
#include <ogr_srs_api.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define EXTENT 8.0

bool town_has(double x, double y, double z)
{
    return z < TOWN_GROUND || (z < TOWN_ROOF && fabs(x) < 2 && fabs(y - 1) < 2);
}

/* Density and colour are the same everywhere; the occupancy grid gives the shape. Of positive features through positive
 * weights the density is e^5 and more; the last layer makes red. */
static void fill_weights(const cn_field *field, float *weights)
{
    for (size_t i = 0; i < field->n_weights; i++)
        weights[i] = 0.2f;
    const cn_layer *last = &field->mlp.layer[CN_LAYER_COLOUR2];
    for (uint32_t o = 0; o < last->out; o++)
        for (uint32_t i = 0; i < last->in; i++)
            weights[last->offset + (size_t)o * last->in + i] = o ? -0.01f : 0;
}

static cn_status write_tile(const char *path)
{
    const cn_box box = { .half_extent = { EXTENT, EXTENT, EXTENT }, .near_m = 3, .far_m = 60, .step = 1.0f / 256 };
    const cn_field_options config = hash_options((hash_sizes){ .levels = 4,
                                                               .log2_table = 10,
                                                               .base_resolution = 8,
                                                               .finest_resolution = 32,
                                                               .density_width = 16,
                                                               .colour_width = 16 });
    cn_field field;
    cn_effect_pack pack;
    CN_TRY(cn_field_layout(&field, &config, (cn_field_inputs){ 0 }));
    CN_TRY(cn_effect_pack_make(&pack, 0, NULL, 1));
    uint16_t *table = malloc(2 * field.entries * sizeof *table);
    float *weights = malloc(field.n_weights * sizeof *weights), nothing[1] = { 0 };
    uint32_t *bits = calloc(CN_OCC_CELLS / 32, sizeof *bits);
    for (size_t i = 0; i < 2 * field.entries; i++)
        table[i] = 0x3f80; /* 1 */
    fill_weights(&field, weights);
    for (uint32_t c = 0; c < CN_OCC_CELLS; c++) {
        float x[3];
        cn_occupancy_centre(c, x);
        if (town_has(EXTENT * x[0], EXTENT * x[1], EXTENT * x[2])) bits[c / 32] |= 1u << c % 32;
    }
    static const char *const names[] = { "0.jpg" };
    const cn_tile_parts parts = { .id = "town",
                                  .parent_hash = "",
                                  .radius_m = 6,
                                  .box = &box,
                                  .field = &field,
                                  .table = table,
                                  .weights = weights,
                                  .occupancy = bits,
                                  .pack = &pack,
                                  .names = names,
                                  .n_names = 1,
                                  .n_trained = 1,
                                  .constants = nothing,
                                  .effect_params = nothing,
                                  .shared = nothing,
                                  .steps = 1 };
    const cn_status status = cn_tile_save(&parts, path);
    free(table);
    free(weights);
    free(bits);
    return status;
}

static void place_views(town *t)
{
    static const double at[TOWN_VIEWS][2] = { { -2, -2 }, { 2, -2 }, { -2, 2 }, { 2, 2 } };
    static const double down[9] = { 1, 0, 0, 0, -1, 0, 0, 0, -1 }; /* north is up in the picture */
    t->camera = (cn_camera){ .lens = CN_LENS_PINHOLE, .width = 80, .height = 80, .params = { 60, 60, 40, 40 } };
    for (uint32_t i = 0; i < TOWN_VIEWS; i++) {
        const double centre[3] = { at[i][0], at[i][1], 7 };
        t->views[i] = (cn_view){ .photo = i };
        memcpy(t->views[i].rotation, down, sizeof down);
        cn_mat3_vec(down, centre, t->views[i].translation);
        for (int k = 0; k < 3; k++)
            t->views[i].translation[k] = -t->views[i].translation[k];
        t->all_views[i] = i;
    }
    for (uint32_t i = 0; i < 3; i++)
        t->observations[i].view = i;
    for (uint32_t i = 0; i < TOWN_POINTS; i++)
        t->points[i] = (cn_point){ .xyz = { 0.1 * i - 2.5, 0, i % 2 ? TOWN_ROOF : TOWN_GROUND }, .n_observations = 3 };
}

cn_status town_init(town *t)
{
    *t = (town){ .folder = "/tmp/conurb_town_XXXXXX" };
    if (!mkdtemp(t->folder)) return cn_fail(CN_ERR_IO, "no folder in /tmp");
    t->tile_file = cn_path_join(t->folder, "tile.safetensors");
    CN_TRY(write_tile(t->tile_file));
    place_views(t);
    cn_frame_init(&t->frame);
    t->scene = (cn_scene){ .cameras = &t->camera,
                           .n_cameras = 1,
                           .views = t->views,
                           .n_views = TOWN_VIEWS,
                           .points = t->points,
                           .n_points = TOWN_POINTS,
                           .observations = t->observations,
                           .n_observations = 3 };
    for (int i = 0; i < 2; i++)
        t->tiles[i] =
            (cn_survey_tile){ .path = t->tile_file, .radius_m = 3, .views = t->all_views, .n_views = TOWN_VIEWS };
    t->survey = (cn_survey){ .scene = &t->scene,
                             .frame = &t->frame,
                             .tiles = t->tiles,
                             .n_tiles = 1,
                             .width_px = 80,
                             .exponent = 4,
                             .reach = 2,
                             .render = cn_render_options_default() };
    return CN_OK;
}

void town_place(town *t)
{
    t->frame.georeferenced = true;
    t->frame.latitude_deg = 47.37;
    t->frame.longitude_deg = 8.54;
    t->frame.height_m = 450;
}

void town_utm(const town *t, const double local[3], double place[3])
{
    double geodetic[3];
    OGRSpatialReferenceH utm = OSRNewSpatialReference(NULL), wgs84 = OSRNewSpatialReference(NULL);
    if (cn_frame_to_geodetic(&t->frame, local, geodetic) != CN_OK || OSRImportFromEPSG(utm, 32632) != OGRERR_NONE ||
        OSRImportFromEPSG(wgs84, 4326) != OGRERR_NONE)
        abort();
    OSRSetAxisMappingStrategy(utm, OAMS_TRADITIONAL_GIS_ORDER);
    OSRSetAxisMappingStrategy(wgs84, OAMS_TRADITIONAL_GIS_ORDER);
    OGRCoordinateTransformationH to = OCTNewCoordinateTransformation(wgs84, utm);
    place[0] = geodetic[1];
    place[1] = geodetic[0];
    place[2] = geodetic[2];
    if (!to || !OCTTransform(to, 1, &place[0], &place[1], NULL)) abort();
    OCTDestroyCoordinateTransformation(to);
    OSRDestroySpatialReference(utm);
    OSRDestroySpatialReference(wgs84);
}

void town_deinit(town *t)
{
    if (folder_remove(t->folder) != 0) abort();
    free(t->tile_file);
}
