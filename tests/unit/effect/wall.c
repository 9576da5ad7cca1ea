#include "wall.h"

#include "../common.h"
#include "base/file.h"
#include "bridge/oiio.h"
#include "effect/tracks.h"
#include "math/linalg.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

double step_m = 0.25, thing_grey = 0.02, gain_stops;
cn_side first_turn;
unsigned border_px;
bool white_wall, windows;

double camera_x(unsigned view)
{
    return step_m * (view - VIEWS / 2.0);
}

/* The dark thing's middle, as far as BOX_M away. */
static double thing_x(before what, unsigned view)
{
    return what == PASSING ? fmod(view * 1.7, 6) - 3 : 0;
}

bool in_thing(before what, unsigned view, const double origin[3], const double dir[3])
{
    if (what == NOTHING || (what == LEAVES && view != LEAVES_VIEW)) return false;
    const double t = BOX_M / dir[1], x = origin[0] + t * dir[0] - thing_x(what, view), z = origin[2] + t * dir[2];
    return fabs(x) < 1 && z > (what == CLOUD ? 5.8 : -2) && z < (what == TOWER || what == CLOUD ? 100 : 3.5);
}

static void colour(const wall *w, before what, unsigned view, const double dir[3], double rgb[3])
{
    static const double tint[3][3] = { { 1, 1, 1 }, { 1, 1, 1 }, { 0.02, 0.06, 0.3 } }, warm[3] = { 3.2, 3, 2.6 };
    const double origin[3] = { camera_x(view), 0, 2 }, t = WALL_M / dir[1];
    const double x = origin[0] + t * dir[0], z = origin[2] + t * dir[2];
    if (white_wall && x < WHITE_TO_M && fabs(z - ROOF_M + 0.25) < 0.25) return (void)memset(rgb, 0, 3 * sizeof *rgb);
    const bool thing = in_thing(what, view, origin, dir), above = !thing && w->sky && z > ROOF_M;
    /* Brighter to the east: photos of the same bytes would be left out. */
    const double squares = (((int)floor(x) + (int)floor(z)) & 1 ? 0.15 : 0.3) * (1 + 0.01 * x);
    const double grey = thing ? thing_grey : above ? 0.6 + 0.004 * (z - ROOF_M) : white_wall ? 0.6 : squares;
    const bool window = windows && !thing && !above && squares > 0.2;
    for (int c = 0; c < 3; c++)
        rgb[c] = grey * (window ? warm : tint[above ? w->sky : NO_SKY])[c];
}

static void draw(wall *w, before what, unsigned view)
{
    static float rgb[3 * WIDTH * HEIGHT];
    for (unsigned i = 0; i < WIDTH * HEIGHT; i++) {
        double in_camera[3], dir[3], seen[3];
        assert_int_equal(cn_camera_unproject(&w->camera, i % WIDTH + 0.5, i / WIDTH + 0.5, in_camera), CN_OK);
        cn_mat3_tvec(w->views[view].rotation, in_camera, dir);
        colour(w, what, view, dir, seen);
        if (i / WIDTH < border_px || i / WIDTH >= HEIGHT - border_px) memset(seen, 0, sizeof seen);
        const double falloff = w->every_second && view % 2 ? 0 : w->falloff;
        const double lens = exp2((view % 2 ? gain_stops : 0) -
                                 falloff * cn_track_square(i % WIDTH + 0.5, i / WIDTH + 0.5, WIDTH, HEIGHT));
        for (int c = 0; c < 3; c++)
            rgb[3 * i + (unsigned)c] = (float)pow(lens * seen[c], 1 / 2.2);
    }
    char *path = cn_path_join(w->folder, w->views[view].name);
    assert_int_equal(cn_oiio_write_png(path, rgb, WIDTH, HEIGHT, 3, NULL), CN_OK);
    free(path);
}

void add_point(wall *w, before what, const double xyz[3], bool of_thing)
{
    cn_point *p = &w->points[w->scene.n_points];
    *p = (cn_point){ .xyz = { xyz[0], xyz[1], xyz[2] }, .first_observation = (uint32_t)w->scene.n_observations };
    for (unsigned v = 0; v < VIEWS; v++) {
        double cam[3], xy[2], dir[3];
        const double origin[3] = { camera_x(v), 0, 2 };
        cn_mat3_vec(w->views[v].rotation, xyz, cam);
        for (int a = 0; a < 3; a++) {
            cam[a] += w->views[v].translation[a];
            dir[a] = xyz[a] - origin[a];
        }
        if (!cn_camera_project(&w->camera, cam, xy) || xy[0] < 0 || xy[1] < 0 || xy[0] >= WIDTH || xy[1] >= HEIGHT)
            continue;
        if (!of_thing && in_thing(what, v, origin, dir)) continue;
        w->observations[w->scene.n_observations++] = (cn_observation){ v, (float)xy[0], (float)xy[1] };
        p->n_observations++;
    }
    w->scene.n_points++;
}

/* Turns the camera about its axis. */
static void turn_view(cn_view *view)
{
    static const double cosine[] = { 1, 0, 0, -1 }, sine[] = { 0, -1, 1, 0 };
    const double c = cosine[first_turn], s = sine[first_turn];
    double *r = view->rotation, *t = view->translation;
    for (int k = 0; k < 4; k++) {
        double *right = k < 3 ? r + k : t, *down = k < 3 ? r + 3 + k : t + 1;
        const double turned[2] = { c * *right - s * *down, s * *right + c * *down };
        *right = turned[0];
        *down = turned[1];
    }
}

void wall_init_through(wall *w, before what, sky_kind sky, double falloff, bool every_second)
{
    memset(w, 0, sizeof *w);
    w->sky = sky;
    w->falloff = falloff;
    w->every_second = every_second;
    strcpy(w->folder, "/tmp/conurb-wall-XXXXXX");
    assert_non_null(mkdtemp(w->folder));
    w->camera = (cn_camera){ .lens = CN_LENS_PINHOLE, .width = WIDTH, .height = HEIGHT, .params = { 80, 80, 48, 36 } };
    w->scene = (cn_scene){ .cameras = &w->camera,
                           .n_cameras = 1,
                           .views = w->views,
                           .n_views = VIEWS,
                           .points = w->points,
                           .observations = w->observations };
    for (unsigned v = 0; v < VIEWS; v++) {
        w->views[v] = (cn_view){ .name = cn_format("%02u.png", v),
                                 .photo = v,
                                 .rotation = { 1, 0, 0, 0, 0, -1, 0, 1, 0 },
                                 .translation = { -camera_x(v), 2, 0 } };
        if (v == 0) turn_view(&w->views[v]);
        w->photos[v] = v;
        draw(w, what, v);
    }
    for (int i = 0; i < ACROSS * UP; i++)
        add_point(w, what, (double[3]){ i % ACROSS - ACROSS / 2 + 0.5, WALL_M, i / ACROSS - 5 + 0.5 }, false);
    for (int i = 0; what == PARKED && i < BOX; i++)
        add_point(w, what, (double[3]){ i % 5 * 0.45 - 0.9, BOX_M, i / 5 * 0.55 - 1.8 }, true);
    w->tile = (cn_plan_tile){ .id = "wall", .photos = w->photos, .n_photos = VIEWS };
    const cn_context quiet = { 0 };
    char *store = cn_path_join(w->folder, "pixels.bin");
    assert_int_equal(cn_photo_index_scan(&quiet, w->folder, &w->index), CN_OK);
    assert_int_equal(cn_pixel_store_build(&quiet, &w->index, WIDTH, store), CN_OK);
    assert_int_equal(cn_pixel_store_open(&w->pixels, store), CN_OK);
    free(store);
}

void wall_init(wall *w, before what, sky_kind sky)
{
    wall_init_through(w, what, sky, 0, false);
}

void wall_deinit(wall *w)
{
    cn_pixel_store_close(&w->pixels);
    cn_photo_index_deinit(&w->index);
    for (unsigned v = 0; v < VIEWS; v++)
        free(w->views[v].name);
    assert_int_equal(folder_remove(w->folder), 0);
}

double evidence(measure of, before what, sky_kind sky)
{
    static wall w;
    wall_init(&w, what, sky);
    const cn_plan_input input = { .scene = &w.scene, .photos = &w.index, .pixels = w.pixels };
    const double value = of(&input, &w.tile);
    wall_deinit(&w);
    return value;
}
