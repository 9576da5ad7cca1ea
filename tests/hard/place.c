/* Extreme places: poles, the antimeridian, the borders of UTM zones, far below the sea and high above it, and a
 * tile 20,000 km from where its frame begins. */
#include "hard.h"

#include "base/file.h"
#include "base/units.h"
#include "bridge/oiio.h"
#include "export/ground_grid.h"
#include "math/linalg.h"
#include "plan/plan.h"
#include "pose/align.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

typedef struct spot {
    const char *what;
    double latitude_deg, longitude_deg, height_m;
} spot;
static const spot spots[] = {
    { "the north pole", 90, 0, 10 },          { "the south pole", -90, 123, 2800 }, { "near a pole", 89.9999, -45, 0 },
    { "the antimeridian", -17, 180, 5 },      { "beside it", 65, -179.99999, 5 },   { "a zone's border", 48, 6, 300 },
    { "a zone's border, equator", 0, 12, 0 }, { "Norway's exception", 60, 3, 20 },  { "Svalbard's", 78, 9, 20 },
    { "the Dead Sea", 31.5, 35.5, -400 },     { "Everest", 27.988, 86.925, 9000 },  { "where UTM ends", 84, 30, 0 },
};
enum { SPOTS = sizeof spots / sizeof *spots };

static cn_frame frame_at(const spot *s)
{
    cn_frame f;
    cn_frame_init(&f);
    f.georeferenced = true;
    f.latitude_deg = s->latitude_deg;
    f.longitude_deg = s->longitude_deg;
    f.height_m = s->height_m;
    return f;
}

/* Cameras in a ring of 40 m with heads upright, in metres about a spot; what a pose maker would have found, in a frame
 * of its own; and the GPS that they have noted. */
enum { CAMERAS = 12 };
typedef struct ring {
    cn_scene scene;
    cn_photo photos[CAMERAS];
    cn_photo_index index;
} ring;

static void ring_init(ring *r, const spot *s)
{
    const cn_frame frame = frame_at(s);
    const double quaternion[4] = { 0.3, -0.5, 0.7, 0.2 };
    double turn[9], back[9];
    memset(r, 0, sizeof *r);
    cn_quat_to_mat3(quaternion, turn);
    cn_mat3_transpose(turn, back);
    r->scene.views = calloc(CAMERAS, sizeof *r->scene.views);
    assert_non_null(r->scene.views);
    r->scene.n_views = CAMERAS;
    for (int i = 0; i < CAMERAS; i++) {
        cn_view *v = &r->scene.views[i];
        const double a = 2 * CN_PI * i / CAMERAS, local[3] = { 40 * cos(a), 40 * sin(a), 2 + i % 3 };
        const double upright[9] = { -sin(a), cos(a), 0, 0, 0, -1, -cos(a), -sin(a), 0 };
        double at[3], centre[3];
        hard_must(cn_frame_to_geodetic(&frame, local, at));
        r->photos[i] = (cn_photo){
            .has_gps = true, .latitude_deg = at[0], .longitude_deg = at[1], .has_altitude = true, .altitude_m = at[2]
        };
        v->name = cn_format("%02d", i);
        v->photo = (uint32_t)i;
        cn_mat3_mul(upright, back, v->rotation);
        cn_mat3_vec(turn, local, centre);
        for (int k = 0; k < 3; k++)
            centre[k] *= 0.27;
        cn_mat3_vec(v->rotation, centre, v->translation);
        for (int k = 0; k < 3; k++)
            v->translation[k] = -v->translation[k];
    }
    r->index = (cn_photo_index){ .photos = r->photos, .n_photos = CAMERAS, .n_gps = CAMERAS };
}

/* Poses come into a frame that begins among their cameras, in metres, and in which up is up.
 * Guard: the mean place in pose/align.c is one of directions from the Earth's centre; with means of latitudes and
 * longitudes in its place the frame of a city on the antimeridian begins 12,000 km away. */
static void test_alignment(void **state)
{
    (void)state;
    for (int i = 0; i < SPOTS; i++) {
        ring r;
        cn_frame frame;
        const cn_context ctx = { 0 };
        ring_init(&r, &spots[i]);
        hard_traps_on();
        hard_must(cn_align(&ctx, &r.scene, &r.index, 5, CN_LEVEL_ALWAYS, &frame));
        hard_traps_off();
        assert_true(frame.georeferenced && frame.n_inliers == CAMERAS);
        for (int k = 0; k < CAMERAS; k++) {
            double centre[3], place[3], again[3];
            cn_view_centre(&r.scene.views[k], centre);
            if (!(cn_norm3(centre) < 60))
                fail_msg("%s: a camera is %g m from where the frame begins", spots[i].what, cn_norm3(centre));
            const double above[3] = { centre[0], centre[1], centre[2] + 100 };
            hard_must(cn_frame_to_geodetic(&frame, centre, place));
            hard_must(cn_frame_to_geodetic(&frame, above, again));
            if (!(fabs(again[2] - place[2] - 100) < 1e-3)) fail_msg("%s: up is not up", spots[i].what);
            const double height = r.photos[k].altitude_m + (frame.geoid_applied ? frame.geoid_height_m : 0);
            if (!(fabs(place[2] - height) < 0.5))
                fail_msg("%s: height %g, GPS says %g", spots[i].what, place[2], height);
        }
        cn_scene_deinit(&r.scene);
    }
}

/* There and back, from a millimetre to as far as the Earth goes. At 20,000 km a place is still told from one a
 * micrometre off. Guard: doubles, all the way (geo/frame.c, bridge/geographiclib.cpp). With a float between them the
 * places are metres off. */
static void test_there_and_back(void **state)
{
    (void)state;
    for (int i = 0; i < SPOTS; i++)
        for (double far_m = 1e-3; far_m < 3e4; far_m *= 10) {
            const cn_frame frame = frame_at(&spots[i]);
            const double local[3] = { 0.6 * far_m, -0.8 * far_m, 0.1 * far_m };
            double place[3], back[3];
            hard_must(cn_frame_to_geodetic(&frame, local, place));
            assert_true(fabs(place[0]) <= 90 && fabs(place[1]) <= 180);
            hard_must(cn_frame_from_geodetic(&frame, place, back));
            assert_true(cn_distance3(local, back) < 1e-8 + 1e-13 * far_m);
        }
    /* 20,000 km: the other side of the Earth. */
    const cn_frame frame = frame_at(&(spot){ "", 0, 0, 0 });
    const double there[3] = { 0.01, 179.9, 25 }, beside[3] = { 0.01, 179.9, 25.001 };
    double local[3], other[3], back[3];
    hard_must(cn_frame_from_geodetic(&frame, there, local));
    hard_must(cn_frame_from_geodetic(&frame, beside, other));
    hard_must(cn_frame_to_geodetic(&frame, local, back));
    assert_true(local[2] < -1.27e7);
    assert_true(fabs(cn_distance3(local, other) - 1e-3) < 1e-7);
    assert_true(fabs(back[0] - there[0]) < 1e-12 && fabs(back[1] - there[1]) < 1e-12 &&
                fabs(back[2] - there[2]) < 1e-7);
}

/* Tiles on either side of a border have names, each its own, and so have those in one place.
 * Guard: the suffix of plan/id.c, and one metre where ten do not tell them apart. */
static void test_names(void **state)
{
    (void)state;
    for (int i = 0; i < SPOTS; i++) {
        const cn_frame frame = frame_at(&spots[i]);
        cn_plan plan = { .n_tiles = 9 };
        plan.tiles = calloc(plan.n_tiles, sizeof *plan.tiles);
        assert_non_null(plan.tiles);
        for (uint32_t t = 0; t < 9; t++) {
            plan.tiles[t].centre[0] = 4 * ((double)(t % 3) - 1);
            plan.tiles[t].centre[1] =
                t == 8 ? -4 : 4 * ((double)(t / 3) - 1); /* the last one is at the place of the third */
        }
        hard_must(cn_plan_ids(&plan, &frame));
        for (uint32_t t = 1; t < 9; t++)
            assert_true(strcmp(plan.tiles[t - 1].id, plan.tiles[t].id) < 0);
        free(plan.tiles);
    }
}

/* A map of a tile on a border is as large as the tile, whatever the zone next door would say of half of it.
 * Guard: one zone for the whole grid, that of the frame's origin (export/ground_grid.c); asked anew for each place, the
 * halves lie 600 km apart, or in other hemispheres. */
static void test_map(void **state)
{
    (void)state;
    for (int i = 0; i < SPOTS; i++) {
        const cn_frame frame = frame_at(&spots[i]);
        const cn_survey_tile tile = { .radius_m = 100 };
        const cn_survey survey = { .frame = &frame, .tiles = &tile, .n_tiles = 1, .reach = 1 };
        const cn_height_sampler sampler = { .survey = &survey, .top_m = 30 };
        cn_ground_grid grid;
        cn_height_samples q;
        hard_must(cn_ground_grid_init(&grid, &sampler, 0.5));
        if (!(grid.across <= 8 && grid.down <= 8))
            fail_msg("%s: a map of %u x %u blocks", spots[i].what, grid.across, grid.down);
        hard_must(cn_height_samples_init(&q, CN_BLOCK * CN_BLOCK));
        for (uint32_t b = 0; b < grid.across * grid.down; b++) {
            hard_must(cn_ground_grid_block(&grid, b % grid.across, b / grid.across, &q));
            for (size_t k = 0; k < q.n; k++)
                if (!(cn_norm3(q.top[k]) < 300 && q.down[k][2] < -0.9999))
                    fail_msg("%s: a sounding at (%g, %g, %g)", spots[i].what, q.top[k][0], q.top[k][1], q.top[k][2]);
        }
        cn_height_samples_deinit(&q);
        cn_ground_grid_deinit(&grid);
    }
}

/* Altitudes of -400 and 9000 m, as cameras write them: a height and a reference.
 * Guard: the reference in bridge/oiio.cpp; without it the Dead Sea is a hill. */
static void test_altitudes(void **state)
{
    (void)state;
    char folder[] = "/tmp/conurb-hard-XXXXXX", command[64];
    assert_non_null(mkdtemp(folder));
    static const double lat[3] = { 31, 30, 0 }, lon[3] = { 35, 30, 0 }, altitudes[2] = { 400, 9000 },
                        below[2] = { 1, 0 };
    float rgb[16 * 16 * 3];
    for (int i = 0; i < 2; i++) {
        const cn_oiio_attribute exif[] = { { "GPS:Latitude", NULL, lat, 3 },
                                           { "GPS:LatitudeRef", "N", NULL, 0 },
                                           { "GPS:Longitude", NULL, lon, 3 },
                                           { "GPS:LongitudeRef", "E", NULL, 0 },
                                           { "GPS:Altitude", NULL, &altitudes[i], 1 },
                                           { "GPS:AltitudeRef", NULL, &below[i], 1 },
                                           { NULL, NULL, NULL, 0 } };
        char path[64];
        for (int p = 0; p < 16 * 16 * 3; p++)
            rgb[p] = (float)((p * 7 + 100 * i) % 255) / 255;
        snprintf(path, sizeof path, "%s/%d.jpg", folder, i);
        hard_must(cn_oiio_write_jpeg(path, rgb, 16, 16, exif));
    }
    cn_photo_index index;
    const cn_context ctx = { 0 };
    hard_must(cn_photo_index_scan(&ctx, folder, &index));
    assert_int_equal(index.n_photos, 2);
    assert_true(fabs(index.photos[0].altitude_m + 400) < 1e-6 && fabs(index.photos[1].altitude_m - 9000) < 1e-6);
    cn_photo_index_deinit(&index);
    snprintf(command, sizeof command, "rm -rf %s", folder);
    assert_int_equal(system(command), 0);
}

static const double away[3] = { 1.6e7, -1.2e7, 12345.678 };

static void move(synthetic_scene *synthetic, const double by[3])
{
    for (uint32_t i = 0; i < synthetic->scene.n_views; i++) {
        cn_view *v = &synthetic->scene.views[i];
        double d[3];
        cn_mat3_vec(v->rotation, by, d);
        for (int a = 0; a < 3; a++)
            v->translation[a] -= d[a];
    }
    for (int a = 0; a < 3; a++) {
        synthetic->tile.bounds_min[a] += by[a];
        synthetic->tile.bounds_max[a] += by[a];
        synthetic->tile.centre[a] += by[a];
    }
}

/* A tile 20,000 km from where its frame begins, by its rays and by a training: as at home, but for the last digits.
 * Guard: cn_ray_generator_init and cn_ray_make subtract the tile's centre in double, before anything becomes float
 * (rays/rays.c); with the centre as a float the cameras stand a metre off. */
static void test_far_tile(void **state)
{
    (void)state;
    synthetic_scene synthetic;
    hard_run home, there;
    hard_scene_init(&synthetic, 3);
    const cn_train_options o = hard_options();
    const hard_trained near = hard_train(&synthetic, &o);
    hard_run_init(&home, &synthetic, &o, NULL);
    hard_must(cn_trainer_step(&home.t));
    move(&synthetic, away);
    hard_run_init(&there, &synthetic, &o, NULL);
    hard_must(cn_trainer_step(&there.t));
    assert_int_equal(home.t.batch.n_rays, there.t.batch.n_rays);
    for (uint32_t r = 0; r < home.t.batch.n_rays; r++)
        for (int a = 0; a < 3; a++) {
            assert_true(home.t.batch.rays[r].box_ray.dir[a] == there.t.batch.rays[r].box_ray.dir[a]);
            assert_true(fabsf(home.t.batch.rays[r].box_ray.origin[a] - there.t.batch.rays[r].box_ray.origin[a]) <
                        2e-7f);
        }
    hard_run_deinit(&home);
    hard_run_deinit(&there);
    const hard_trained far = hard_train(&synthetic, &o);
    print_message("PSNR at home %.3f dB, far away %.3f dB\n", near.psnr, far.psnr);
    assert_true(fabs(near.psnr - far.psnr) < 0.3);
    /* The same in a render. */
    cn_tile *tile = NULL;
    const cn_context ctx = { 0 };
    const cn_render_options r = cn_render_options_default();
    hard_must(cn_tile_open(&tile, far.tile));
    double origin[3] = { 4 + away[0], away[1], 1.5 + away[2] };
    static const double dir[3] = { -0.9363291775690445, 0, -0.3511234415883917 };
    float rgba[4], depth;
    hard_must(cn_render_rays(&ctx, tile, &(cn_ray_list){ 1, (const double(*)[3])origin, &dir }, &r, rgba, &depth));
    assert_true(isfinite(rgba[0]) && rgba[3] > 0.3f && depth > 1 && depth < 30);
    cn_tile_close(&tile);
    synthetic_scene_deinit(&synthetic);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_alignment), cmocka_unit_test(test_there_and_back), cmocka_unit_test(test_names),
        cmocka_unit_test(test_map),       cmocka_unit_test(test_altitudes),      cmocka_unit_test(test_far_tile),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
