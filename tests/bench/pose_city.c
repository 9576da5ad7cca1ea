#include "pose_city.h"

#include "base/rng.h"
#include "base/units.h"
#include "math/linalg.h"
#include "pose/scene.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { WIDTH = 1000, HEIGHT = 750, NEIGHBOURS = 20, REACH = 9 };
enum { RIG, GPS, POINT, SEE, NOISE, MODEL = 100 };
#define STEP_M 8.0
#define FLIGHT_M 50.0
#define SEEN_SHARE 0.12
#define NOISE_PX 0.5
#define OUTLIERS 0.005
#define BEND_M 0.3 /* of a model, at its border */
#define BORDER_M 60.0
#define UNPOSED 0.03
#define LENS_OFF 0.002

static void *room(size_t n, size_t size)
{
    void *p = calloc(n + 1, size);
    if (p) return p;
    fputs("out of memory\n", stderr);
    exit(1);
}

static void must(cn_status status)
{
    if (status == CN_OK) return;
    fprintf(stderr, "%s\n", cn_error_message());
    exit(1);
}

static double chance(uint64_t stream, uint64_t counter)
{
    return cn_rng_float(1, stream, counter);
}

static double gauss(uint64_t stream, uint64_t counter)
{
    return sqrt(-2 * log(1 - chance(stream, 2 * counter))) * cos(2 * CN_PI * chance(stream, 2 * counter + 1));
}

static void axis_angle(const double w[3], double m[9])
{
    const double angle = cn_norm3(w), s = angle > 0 ? sin(angle / 2) / angle : 0.5;
    const double q[4] = { cos(angle / 2), s * w[0], s * w[1], s * w[2] };
    cn_quat_to_mat3(q, m);
}

/* ---- The truth ---- */

/* Looks down, or obliquely to one of four sides. */
static void make_view(cn_view *view, uint32_t i, uint32_t side)
{
    const double turn = cn_radians(90.0 * (i % 5)), tilt = i % 5 == 4 ? 0.0 : cn_radians(35);
    const double centre[3] = { STEP_M * (i % side + 0.3 * gauss(RIG, 3 * (uint64_t)i)),
                               STEP_M * ((double)(i / side) + 0.3 * gauss(RIG, 3 * (uint64_t)i + 1)),
                               FLIGHT_M + 2 * gauss(RIG, 3 * (uint64_t)i + 2) };
    const double down[9] = { 1, 0, 0, 0, -1, 0, 0, 0, -1 };
    double about[9], lean[9], both[9], moved[3];
    axis_angle((const double[3]){ 0, 0, turn }, about);
    axis_angle((const double[3]){ tilt, 0, 0 }, lean);
    cn_mat3_mul(lean, down, both);
    cn_mat3_mul(both, about, view->rotation);
    cn_mat3_vec(view->rotation, centre, moved);
    for (int k = 0; k < 3; k++)
        view->translation[k] = -moved[k];
    view->photo = i;
    char name[32];
    snprintf(name, sizeof name, "%06u.jpg", i);
    view->name = strdup(name);
    if (!view->name) exit(1);
}

static void see(pose_city *city, uint32_t photo, uint32_t p, uint64_t key)
{
    const cn_view *view = &city->truth.views[photo];
    cn_point *point = &city->truth.points[p];
    double cam[3], xy[2];
    cn_mat3_vec(view->rotation, point->xyz, cam);
    for (int k = 0; k < 3; k++)
        cam[k] += view->translation[k];
    if (!cn_camera_project(city->truth.cameras, cam, xy)) return;
    if (!(xy[0] > 0 && xy[0] < WIDTH && xy[1] > 0 && xy[1] < HEIGHT)) return;
    const double far = chance(NOISE, 3 * key) < OUTLIERS ? 60 : 1;
    city->truth.observations[city->truth.n_observations++] =
        (cn_observation){ photo, (float)(xy[0] + far * NOISE_PX * gauss(NOISE + 1, 2 * key)),
                          (float)(xy[1] + far * NOISE_PX * gauss(NOISE + 1, 2 * key + 1)) };
    point->n_observations++;
}

static void make_points(pose_city *city, uint32_t side, uint32_t a_photo)
{
    cn_scene *t = &city->truth;
    const uint32_t n = t->n_views, rows = (n + side - 1) / side;
    /* Photos at the border look beyond it. */
    const uint64_t most = (uint64_t)(side + 2 * REACH) * (rows + 2 * REACH) * a_photo;
    size_t space = (size_t)most * 10 + 4096;
    t->points = room(most, sizeof *t->points);
    t->observations = room(space, sizeof *t->observations);
    for (uint64_t p = 0; p < most; p++) {
        cn_point *point = &t->points[t->n_points];
        const double x = chance(POINT, 3 * p) * (side + 2 * REACH) - REACH;
        const double y = chance(POINT, 3 * p + 1) * (rows + 2 * REACH) - REACH;
        *point = (cn_point){ .xyz = { STEP_M * x, STEP_M * y, 20 * pow(chance(POINT, 3 * p + 2), 3) },
                             .rgb = { 128, 128, 128 },
                             .first_observation = (uint32_t)t->n_observations };
        for (int dy = -REACH; dy <= REACH; dy++)
            for (int dx = -REACH; dx <= REACH; dx++) {
                const int col = (int)floor(x) + dx, row = (int)floor(y) + dy;
                const uint64_t photo = (uint64_t)row * side + (uint64_t)col,
                               key = p * 400 + (uint64_t)((dy + 9) * 20 + dx + 9);
                if (col < 0 || row < 0 || col >= (int)side || photo >= n || chance(SEE, key) > SEEN_SHARE) continue;
                if (t->n_observations + 400 > space) {
                    space *= 2;
                    t->observations = realloc(t->observations, space * sizeof *t->observations);
                    if (!t->observations) exit(1);
                }
                see(city, (uint32_t)photo, t->n_points, key);
            }
        if (point->n_observations >= 2)
            t->n_points++;
        else
            t->n_observations = point->first_observation;
    }
}

static void make_index(pose_city *city, const pose_city_options *o)
{
    double geoid = 0;
    bool found;
    city->index = (cn_photo_index){ .folder = strdup("/made"), .n_photos = o->n_photos };
    city->index.photos = room(o->n_photos, sizeof *city->index.photos);
    city->index.n_gps = o->has_gps ? o->n_photos : 0;
    must(cn_geo_geoid_height(city->frame.latitude_deg, city->frame.longitude_deg, &geoid, &found));
    for (uint32_t i = 0; i < o->n_photos; i++) {
        double at[3], place[3];
        cn_view_centre(&city->truth.views[i], at);
        for (int k = 0; k < 3; k++)
            at[k] += (k == 2 ? 1.5 : 1.0) * o->gps_sigma_m * gauss(GPS, 3 * (uint64_t)i + (uint64_t)k);
        must(cn_frame_to_geodetic(&city->frame, at, place));
        city->index.photos[i] = (cn_photo){ .name = strdup(city->truth.views[i].name),
                                            .width = WIDTH,
                                            .height = HEIGHT,
                                            .orientation = 1,
                                            .has_gps = o->has_gps,
                                            .latitude_deg = place[0],
                                            .longitude_deg = place[1],
                                            .has_altitude = o->has_gps,
                                            .altitude_m = place[2] - geoid,
                                            .time_s = NAN,
                                            .exposure_s = NAN,
                                            .iso = NAN,
                                            .f_number = NAN,
                                            .focal_mm = NAN,
                                            .focal_35mm = NAN,
                                            .camera = strdup("made"),
                                            .hash = i };
    }
}

void pose_city_make(pose_city *city, const pose_city_options *o)
{
    const uint32_t side = (uint32_t)ceil(sqrt(o->n_photos));
    *city = (pose_city){ 0 };
    cn_frame_init(&city->frame);
    city->frame.georeferenced = true;
    city->frame.latitude_deg = 48.1;
    city->frame.longitude_deg = 11.5;
    city->frame.height_m = 500;
    cn_scene *t = &city->truth;
    t->cameras = room(1, sizeof *t->cameras);
    t->n_cameras = 1;
    t->cameras[0] = (cn_camera){
        1, CN_LENS_OPENCV, WIDTH, HEIGHT, { 700, 700, WIDTH / 2.0, HEIGHT / 2.0, -0.03, 0.005, 0.0003, -0.0002 }
    };
    t->views = room(o->n_photos, sizeof *t->views);
    t->n_views = o->n_photos;
    for (uint32_t i = 0; i < o->n_photos; i++)
        make_view(&t->views[i], i, side);
    make_points(city, side, o->points);
    make_index(city, o);
}

void pose_city_free(pose_city *city)
{
    cn_scene_deinit(&city->truth);
    cn_photo_index_deinit(&city->index);
}

void pose_city_split(const pose_city *city, uint32_t most, cn_photo_groups *groups)
{
    cn_photo_pairs pairs = { 0 };
    double(*places)[2];
    must(cn_photo_places(&city->index, &places));
    must(places ? cn_photo_pairs_near(&city->index, NEIGHBOURS, &pairs)
                : cn_photo_pairs_in_sequence(&city->index, &pairs));
    const cn_group_split split = { city->index.n_photos, (const double(*)[2])places, &pairs, most };
    must(cn_photo_groups_split(&split, groups));
    cn_photo_pairs_deinit(&pairs);
    free(places);
}

/* ---- Models of groups ---- */

/* A bowl about the middle of the group, of one sign or the other, and the turn of a camera in it. */
typedef struct bend {
    double middle[2], k;
} bend;

static void bend_point(const bend *b, double xyz[3], double turn[3])
{
    const double x = xyz[0] - b->middle[0], y = xyz[1] - b->middle[1];
    xyz[2] += b->k * (x * x + y * y);
    if (!turn) return;
    turn[0] = 2 * b->k * y;
    turn[1] = -2 * b->k * x;
    turn[2] = 0;
}

static void bend_view(const bend *b, cn_view *view, uint64_t key)
{
    double centre[3], turn[3], m[9], back[9], made[9], moved[3];
    cn_view_centre(view, centre);
    bend_point(b, centre, turn);
    for (int k = 0; k < 3; k++) {
        centre[k] += 0.02 * gauss(MODEL + 1, 6 * key + (uint64_t)k);
        turn[k] += cn_radians(0.02) * gauss(MODEL + 1, 6 * key + 3 + (uint64_t)k);
    }
    axis_angle(turn, m);
    cn_mat3_transpose(m, back);
    cn_mat3_mul(view->rotation, back, made);
    memcpy(view->rotation, made, sizeof made);
    cn_mat3_vec(view->rotation, centre, moved);
    for (int k = 0; k < 3; k++)
        view->translation[k] = -moved[k];
}

static bend bend_of(const pose_city *city, const cn_photo_group *group, uint32_t g)
{
    bend b = { .k = (g % 2 ? 1 : -1) * BEND_M / (BORDER_M * BORDER_M) };
    for (uint32_t i = 0; i < group->n; i++) {
        double centre[3];
        cn_view_centre(&city->truth.views[group->photos[i]], centre);
        b.middle[0] += centre[0] / group->n;
        b.middle[1] += centre[1] / group->n;
    }
    return b;
}

static void move_away(cn_scene *scene, uint32_t g)
{
    double w[3], m[9], t[3];
    for (int k = 0; k < 3; k++) {
        w[k] = 2 * gauss(MODEL + 2, 10 * (uint64_t)g + (uint64_t)k);
        t[k] = 500 * gauss(MODEL + 2, 10 * (uint64_t)g + 3 + (uint64_t)k);
    }
    axis_angle(w, m);
    cn_scene_transform(scene, exp(0.5 * gauss(MODEL + 2, 10 * (uint64_t)g + 6)), m, t);
}

static int by_number(const void *a, const void *b)
{
    const uint32_t x = *(const uint32_t *)a, y = *(const uint32_t *)b;
    return (x > y) - (x < y);
}

/* A group's points with their observations; out->points NULL: only counts them. */
static void copy_points(const cn_scene *t, const uint32_t *view_of, const bend *b, uint32_t g, cn_scene *out)
{
    out->n_points = 0;
    out->n_observations = 0;
    for (uint32_t i = 0; i < t->n_points; i++) {
        const cn_observation *seen = t->observations + t->points[i].first_observation;
        const uint64_t before = out->n_observations;
        for (uint32_t k = 0; k < t->points[i].n_observations; k++) {
            const uint32_t view = view_of[seen[k].view];
            if (view == UINT32_MAX) continue;
            if (out->points)
                out->observations[out->n_observations] = (cn_observation){ view, seen[k].x_px, seen[k].y_px };
            out->n_observations++;
        }
        if (out->n_observations - before < 2) {
            out->n_observations = before;
            continue;
        }
        cn_point *point = out->points ? &out->points[out->n_points] : NULL;
        out->n_points++;
        if (!point) continue;
        *point = t->points[i];
        point->first_observation = (uint32_t)before;
        point->n_observations = (uint32_t)(out->n_observations - before);
        bend_point(b, point->xyz, NULL);
        for (int k = 0; k < 3; k++)
            point->xyz[k] += 0.03 * gauss(MODEL + 3, ((uint64_t)g << 34) + 3 * (uint64_t)i + (uint64_t)k);
    }
}

void pose_city_model(const pose_city *city, const cn_photo_groups *groups, uint32_t g, cn_scene *out)
{
    const cn_scene *t = &city->truth;
    const cn_photo_group *group = &groups->groups[g];
    uint32_t *sorted = room(group->n, sizeof *sorted), *view_of = room(t->n_views, sizeof *view_of);
    const bend b = bend_of(city, group, g);
    memcpy(sorted, group->photos, group->n * sizeof *sorted);
    qsort(sorted, group->n, sizeof *sorted, by_number);
    *out = (cn_scene){ .cameras = room(1, sizeof *out->cameras),
                       .n_cameras = 1,
                       .views = room(group->n, sizeof *out->views) };
    out->cameras[0] = t->cameras[0];
    for (int k = 0; k < 2; k++)
        out->cameras[0].params[k] *= 1 + LENS_OFF * (g % 3 - 1.0);
    memset(view_of, 0xff, t->n_views * sizeof *view_of);
    for (uint32_t i = 0; i < group->n; i++) {
        const uint64_t key = (uint64_t)g << 32 | sorted[i];
        if (chance(MODEL, key) < UNPOSED) continue;
        cn_view view = t->views[sorted[i]];
        view.name = strdup(view.name);
        bend_view(&b, &view, key);
        view_of[sorted[i]] = out->n_views;
        out->views[out->n_views++] = view;
    }
    copy_points(t, view_of, &b, g, out);
    out->points = room(out->n_points, sizeof *out->points);
    out->observations = room(out->n_observations, sizeof *out->observations);
    copy_points(t, view_of, &b, g, out);
    move_away(out, g);
    free(sorted);
    free(view_of);
}

/* ---- Errors ---- */

pose_city_error pose_city_compare(const pose_city *city, const cn_scene *scene, const cn_frame *frame)
{
    pose_city_error e = { .n = scene->n_views };
    double(*have)[3] = room(scene->n_views, sizeof *have), (*want)[3] = room(scene->n_views, sizeof *want);
    double square = 0, fitted = 0;
    for (uint32_t i = 0; i < scene->n_views; i++) {
        double at[3], place[3];
        cn_view_centre(&city->truth.views[scene->views[i].photo], want[i]);
        cn_view_centre(&scene->views[i], have[i]);
        if (!frame->georeferenced) continue;
        must(cn_frame_to_geodetic(frame, have[i], place));
        must(cn_frame_from_geodetic(&city->frame, place, at));
        const double off = cn_distance3(at, want[i]);
        square += off * off;
        e.most_m = fmax(e.most_m, off);
    }
    const cn_similarity_task task = {
        scene->n_views, (const double(*)[3])have, (const double(*)[3])want, 1e9, 1.0, 1, NULL
    };
    cn_similarity s;
    must(cn_pose_fit_similarity(&task, &s, NULL));
    for (uint32_t i = 0; i < scene->n_views; i++) {
        double turned[3], off = 0;
        cn_mat3_vec(s.rotation, have[i], turned);
        for (int k = 0; k < 3; k++) {
            const double d = s.scale * turned[k] + s.translation[k] - want[i][k];
            off += d * d;
        }
        fitted += off;
    }
    e.rms_m = frame->georeferenced ? sqrt(square / e.n) : NAN;
    e.fit_rms_m = sqrt(fitted / e.n);
    free(have);
    free(want);
    return e;
}
