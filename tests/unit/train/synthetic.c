#include "../field/options.h"
#include "synthetic.h"

#include "base/file.h"
#include "base/srgb.h"
#include "bridge/oiio.h"
#include "math/linalg.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { WIDTH = 48, HEIGHT = 36 };

static void must(cn_status status)
{
    if (status == CN_OK) return;
    fprintf(stderr, "synthetic scene: %s\n", cn_error_message());
    abort();
}

static void look_at_centre(cn_view *view, double angle)
{
    const double c[3] = { 4 * cos(angle), 4 * sin(angle), 1.5 };
    double z[3] = { -c[0], -c[1], -c[2] }, up[3] = { 0, 0, 1 }, x[3], y[3];
    cn_normalize3(z);
    cn_cross3(z, up, x);
    cn_normalize3(x);
    cn_cross3(z, x, y);
    for (int a = 0; a < 3; a++) {
        view->rotation[a] = x[a];
        view->rotation[3 + a] = y[a];
        view->rotation[6 + a] = z[a];
    }
    double t[3];
    cn_mat3_vec(view->rotation, c, t);
    for (int a = 0; a < 3; a++)
        view->translation[a] = -t[a];
}

/* Linear light of a ray: two balls before a floor of squares, which is black at night. */
static void shade(const double o[3], const double d[3], bool night, double rgb[3])
{
    static const double ball[2][7] = { { 0, 0, 0.6, 0.8, 0.7, 0.2, 0.1 }, { 1, 0.8, 0.3, 0.5, 0.1, 0.3, 0.7 } };
    double nearest = 1e9;
    rgb[0] = rgb[1] = rgb[2] = 0.4;
    if (d[2] < 0) {
        nearest = (-0.4 - o[2]) / d[2];
        const double x = o[0] + nearest * d[0], y = o[1] + nearest * d[1];
        const bool dark = ((int)floor(x) + (int)floor(y)) & 1;
        rgb[0] = rgb[1] = rgb[2] = night ? 0 : dark ? 0.1 : 0.5;
    }
    for (int b = 0; b < 2; b++) {
        double m[3];
        for (int a = 0; a < 3; a++)
            m[a] = o[a] - ball[b][a];
        const double h = cn_dot3(m, d), q = h * h - cn_dot3(m, m) + ball[b][3] * ball[b][3];
        if (q < 0 || -h - sqrt(q) < 0 || -h - sqrt(q) > nearest) continue;
        nearest = -h - sqrt(q);
        for (int a = 0; a < 3; a++)
            rgb[a] = ball[b][4 + a];
    }
}

static void draw(const cn_camera *camera, const cn_view *view, double gain, bool night, float *rgb)
{
    double centre[3];
    cn_view_centre(view, centre);
    for (uint32_t i = 0; i < WIDTH * HEIGHT; i++) {
        double dir[3], world[3], light[3];
        must(cn_camera_unproject(camera, i % WIDTH + 0.5, i / WIDTH + 0.5, dir));
        cn_mat3_tvec(view->rotation, dir, world);
        shade(centre, world, night, light);
        for (int c = 0; c < 3; c++) {
            const double x = fmin(light[c] * gain, 1);
            rgb[3 * i + (uint32_t)c] = (float)cn_srgb_encode(x);
        }
    }
}

static void make(synthetic_scene *synthetic, unsigned n, bool night)
{
    memset(synthetic, 0, sizeof *synthetic);
    strcpy(synthetic->folder, "/tmp/conurb-made-XXXXXX");
    if (!mkdtemp(synthetic->folder)) abort();
    synthetic->scene.cameras = calloc(1, sizeof *synthetic->scene.cameras);
    synthetic->scene.cameras[0] =
        (cn_camera){ .id = 1, .lens = CN_LENS_PINHOLE, .width = WIDTH, .height = HEIGHT, .params = { 45, 45, 24, 18 } };
    synthetic->scene.n_cameras = 1;
    synthetic->scene.views = calloc(n, sizeof *synthetic->scene.views);
    synthetic->scene.n_views = n;
    float rgb[WIDTH * HEIGHT * 3];
    for (unsigned i = 0; i < n; i++) {
        cn_view *v = &synthetic->scene.views[i];
        look_at_centre(v, i * 0.9);
        v->photo = i;
        v->name = cn_format("%03u.png", i);
        char *path = cn_path_join(synthetic->folder, v->name);
        draw(&synthetic->scene.cameras[0], v, exp2((double)(i % 3) - 1) * 0.8, night, rgb);
        must(cn_oiio_write_png(path, rgb, WIDTH, HEIGHT, 3, NULL));
        free(path);
    }
    const cn_context quiet = { 0 };
    must(cn_photo_index_scan(&quiet, synthetic->folder, &synthetic->index));
    for (unsigned i = 0; i < n; i++)
        synthetic->index.photos[i].exposure_s = exp2((double)(i % 3) - 1) * 0.01;
    char *store = cn_path_join(synthetic->folder, "pixels.bin");
    must(cn_pixel_store_build(&quiet, &synthetic->index, WIDTH, store));
    must(cn_pixel_store_open(&synthetic->pixels, store));
    free(store);
    cn_frame_init(&synthetic->frame);
    cn_plan_tile *t = &synthetic->tile;
    strcpy(t->id, "made");
    t->radius_m = 5;
    t->near_m = 1;
    t->far_m = 30;
    for (int a = 0; a < 3; a++)
        t->bounds_min[a] = -4.5, t->bounds_max[a] = 4.5;
    t->photos = calloc(n, sizeof *t->photos);
    t->held_out = calloc(n, sizeof *t->held_out);
    for (unsigned i = 0; i < n; i++)
        if (i % 8)
            t->photos[t->n_photos++] = i;
        else
            t->held_out[t->n_held_out++] = i;
}

void synthetic_scene_init(synthetic_scene *synthetic, unsigned n)
{
    make(synthetic, n, false);
}

void synthetic_night_init(synthetic_scene *synthetic, unsigned n)
{
    make(synthetic, n, true);
}

void synthetic_scene_deinit(synthetic_scene *synthetic)
{
    cn_pixel_store_close(&synthetic->pixels);
    cn_scene_deinit(&synthetic->scene);
    cn_photo_index_deinit(&synthetic->index);
    free(synthetic->tile.photos);
    free(synthetic->tile.held_out);
    if (cn_folder_remove(synthetic->folder) != CN_OK) abort();
}

cn_train_options synthetic_options(void)
{
    cn_train_options o = cn_train_options_preset(CN_QUALITY_PREVIEW);
    o.steps = 60;
    o.samples_per_step = 8192;
    field_set(&o.field, "levels", 6);
    field_set(&o.field, "log2_table", 12);
    field_set(&o.field, "finest_resolution", 128);
    field_set(&o.field, "density_width", 16);
    field_set(&o.field, "colour_width", 16);
    o.march_step = 1.0 / 64;
    o.checkpoint_every_s = 1e9;
    return o;
}

void synthetic_begin(cn_trainer *t, const cn_context *ctx, const cn_train_input *input, const cn_train_options *options)
{
    cn_arena counter;
    cn_arena_count(&counter);
    t->ctx = ctx;
    must(cn_trainer_plan(t, input, options, 1));
    cn_trainer_carve(t, &counter);
    must(cn_device_arena_init(ctx, &t->arena, counter.used));
    cn_trainer_carve(t, &t->arena);
    must(cn_trainer_begin(t));
}

bool same_bytes(const char *a, const char *b)
{
    char *x = NULL, *y = NULL;
    size_t n = 0, m = 0;
    must(cn_file_read(a, 0, &x, &n));
    must(cn_file_read(b, 0, &y, &m));
    const bool same = n == m && memcmp(x, y, n) == 0;
    free(x);
    free(y);
    return same;
}
