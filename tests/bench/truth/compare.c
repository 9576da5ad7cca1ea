/* Renders and refined poses against the truth of a synthetic city (conurb-synth), for truth.sh.
 *   compare relit TRUTH.json PHOTO CLEAN.exr RENDER.png
 *       PSNR of a render in the light of PHOTO; CLEAN.exr is the view in that light, developed here with the gain
 *       and the white balance that PHOTO was developed with
 *   compare depth TRUTH.exr RENDER.exr
 *       median of |d - D| / D over what is no sky; by their channels Z
 *   compare normals MODEL VIEWS OUT NOISE
 *       a normal map OUT/NAME.exr (OpenGL axes) for each view of the COLMAP model, from the exact depth VIEWS/NAME.exr
 *       along the rays; black at the sky and at edges. Each component is off by up to NOISE before the length is 1
 *   compare cue MODEL VIEWS OUT SCALE SHIFT NOISE
 *       a map OUT/NAME.exr for each view as a network may give it: (SCALE * depth + SHIFT) (1 + NOISE u), u in [-1, 1]
 *   compare plant MODEL OUT DEGREES METRES
 *       the COLMAP model with every camera turned and moved so far, in directions by chance
 *   compare darken IN.jpg OUT.jpg STOPS
 *       the photo with corners so much darker than the middle; between them by the squared distance
 *   compare poses TRUTH PLANTED TILE.safetensors
 *       mean turn and move of the photos trained on, planted and refined, to the truth */
#include "base/srgb.h"
#include "base/json.h"
#include "base/rng.h"
#include "base/units.h"
#include "bridge/oiio.h"
#include "conurb/colour.h"
#include "conurb/measure.h"
#include "conurb/pose.h"
#include "conurb/tile.h"
#include "math/linalg.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define MOVE 0.2 /* of the mean half extent, as in src/effect/pose_refinement.c */

static cn_status refuse(const char *what)
{
    return cn_fail(CN_ERR_USAGE, "%s; see the head of compare.c", what);
}

/* ---- relighting ---- */

static cn_status find_photo(const json_t *root, const char *name, double gain[3])
{
    size_t i;
    json_t *photo;
    json_array_foreach(json_object_get(root, "photos"), i, photo)
    {
        const char *have = json_string_value(json_object_get(photo, "name"));
        if (!have || strcmp(have, name) != 0) continue;
        for (size_t c = 0; c < 3; c++)
            gain[c] = json_number_value(json_object_get(photo, "gain")) *
                      json_number_value(json_array_get(json_object_get(photo, "white_balance"), c));
        return CN_OK;
    }
    return cn_fail(CN_ERR_USAGE, "no photo %s in the truth", name);
}

static float encode(double x)
{
    if (!(x > 0)) return 0;
    if (x >= 1) return 1;
    return (float)cn_srgb_encode(x);
}

/* RGBA to RGB in place, as a camera would have written it (gain of sRGB's primaries), or as it is. */
static void develop(float *pixels, size_t n, const double *gain)
{
    for (size_t i = 0; i < n; i++) {
        const double p[3] = { pixels[4 * i], pixels[4 * i + 1], pixels[4 * i + 2] };
        double srgb[3];
        cn_mat3_vec(cn_srgb_from_acescg, p, srgb);
        for (size_t c = 0; c < 3; c++)
            pixels[3 * i + c] = gain ? encode(srgb[c] * gain[c]) : (float)p[c];
    }
}

static cn_status read_pair(char **names, float *picture[2], size_t *n)
{
    uint32_t w[2], h[2];
    for (int i = 0; i < 2; i++)
        CN_TRY(cn_oiio_read_rgba(names[i], &picture[i], &w[i], &h[i]));
    *n = (size_t)w[0] * h[0];
    return w[0] == w[1] && h[0] == h[1] ? CN_OK : refuse("the pictures are not of one size");
}

static cn_status relit(char **argv)
{
    json_t *root = NULL;
    float *picture[2] = { NULL, NULL };
    size_t n = 0;
    double gain[3];
    CN_TRY(cn_json_load(argv[0], &root));
    cn_status status = find_photo(root, argv[1], gain);
    if (status == CN_OK) status = read_pair(argv + 2, picture, &n);
    if (status == CN_OK) {
        develop(picture[0], n, gain);
        develop(picture[1], n, NULL);
        printf("%.2f\n", cn_measure_psnr(picture[0], picture[1], NULL, n));
    }
    json_decref(root);
    free(picture[0]);
    free(picture[1]);
    return status;
}

/* ---- depth ---- */

/* Sky has no depth. */
static cn_status depth(char **argv)
{
    cn_oiio_map map[2] = { { 0 } };
    size_t seen = 0;
    cn_status status = cn_oiio_read_map(argv[0], 1, &map[0]);
    if (status == CN_OK) status = cn_oiio_read_map(argv[1], 1, &map[1]);
    if (status == CN_OK && (map[0].width != map[1].width || map[0].height != map[1].height))
        status = refuse("the pictures are not of one size");
    const size_t n = (size_t)map[0].width * map[0].height;
    double *error = status == CN_OK ? malloc((n + 1) * sizeof *error) : NULL;
    if (status == CN_OK && !error) status = cn_fail(CN_ERR_NOMEM, "out of memory");
    for (size_t i = 0; status == CN_OK && i < n; i++) {
        const double truth = (double)map[0].values[i];
        if (truth > 0) error[seen++] = fabs((double)map[1].values[i] - truth) / truth;
    }
    if (status == CN_OK && seen) printf("%.5f\n", cn_select(error, seen, seen / 2));
    free(error);
    free(map[0].values);
    free(map[1].values);
    return status;
}

/* ---- normals ---- */

/* The place that a pixel shows, in the camera's axes. False for the sky. */
static bool place(const cn_camera *camera, const cn_oiio_map *map, uint32_t x, uint32_t y, double out[3])
{
    const double far = x < map->width && y < map->height ? (double)map->values[(size_t)y * map->width + x] : 0;
    if (!(far > 0) || cn_camera_unproject(camera, x + 0.5, y + 0.5, out) != CN_OK) return false;
    for (int a = 0; a < 3; a++)
        out[a] *= far;
    return true;
}

#define EDGE 1.1 /* neighbours whose distances differ by this factor are of two surfaces */

/* The normal of the triangle of a pixel, the next one and the one below, towards the camera; in OpenGL's axes. */
static void facet(const cn_camera *camera, const cn_oiio_map *map, uint32_t x, uint32_t y, float rgba[4])
{
    double p[3][3], n[3], least = INFINITY, most = 0;
    rgba[0] = rgba[1] = rgba[2] = 0;
    rgba[3] = 1;
    for (uint32_t k = 0; k < 3; k++) {
        if (!place(camera, map, x + (k == 1), y + (k == 2), p[k])) return;
        least = fmin(least, cn_norm3(p[k]));
        most = fmax(most, cn_norm3(p[k]));
    }
    if (most > EDGE * least) return;
    for (int a = 0; a < 3; a++)
        p[1][a] -= p[0][a], p[2][a] -= p[0][a];
    for (int a = 0; a < 3; a++)
        n[a] = p[2][(a + 1) % 3] * p[1][(a + 2) % 3] - p[2][(a + 2) % 3] * p[1][(a + 1) % 3];
    cn_normalize3(n);
    for (int a = 0; a < 3; a++)
        rgba[a] = (float)(a ? -n[a] : n[a]);
}

static void disturb(float normal[3], double noise, uint32_t seed, uint64_t pixel)
{
    double n[3];
    for (uint64_t a = 0; a < 3; a++)
        n[a] = (double)normal[a] + noise * (2 * (double)cn_rng_float(seed, 8, 3 * pixel + a) - 1);
    if (cn_norm3(n) > 0.5) cn_normalize3(n);
    for (int a = 0; a < 3; a++)
        normal[a] = (float)n[a];
}

static cn_status write_normals(const cn_scene *scene, uint32_t i, char **argv)
{
    const cn_view *view = &scene->views[i];
    const char *views = argv[1], *out = argv[2];
    const double noise = strtod(argv[3], NULL);
    const int stem = (int)(strrchr(view->name, '.') - view->name);
    char from[1024], to[1024];
    cn_oiio_map map;
    cn_camera camera;
    snprintf(from, sizeof from, "%s/%.*s.exr", views, stem, view->name);
    snprintf(to, sizeof to, "%s/%.*s.exr", out, stem, view->name);
    CN_TRY(cn_oiio_read_map(from, 1, &map));
    cn_camera_resize(&scene->cameras[view->camera], map.width, map.height, &camera);
    float *rgba = malloc((size_t)map.width * map.height * 4 * sizeof *rgba);
    for (uint32_t y = 0; rgba && y < map.height; y++)
        for (uint32_t x = 0; x < map.width; x++) {
            float *normal = rgba + 4 * ((size_t)y * map.width + x);
            facet(&camera, &map, x, y, normal);
            if (normal[0] * normal[0] + normal[1] * normal[1] + normal[2] * normal[2] > 0)
                disturb(normal, noise, i, (uint64_t)y * map.width + x);
        }
    const cn_status status =
        rgba ? cn_oiio_write_exr(to, rgba, NULL, map.width, map.height, NULL) : cn_fail(CN_ERR_NOMEM, "out of memory");
    free(rgba);
    free(map.values);
    return status;
}

static cn_status write_cue(const cn_view *view, uint32_t seed, char **argv)
{
    const int stem = (int)(strrchr(view->name, '.') - view->name);
    const double scale = strtod(argv[3], NULL), shift = strtod(argv[4], NULL), noise = strtod(argv[5], NULL);
    char from[1024], to[1024];
    cn_oiio_map map;
    snprintf(from, sizeof from, "%s/%.*s.exr", argv[1], stem, view->name);
    snprintf(to, sizeof to, "%s/%.*s.exr", argv[2], stem, view->name);
    CN_TRY(cn_oiio_read_map(from, 1, &map));
    const size_t n = (size_t)map.width * map.height;
    float *rgba = calloc(4 * n, sizeof *rgba);
    for (size_t i = 0; i < n; i++)
        if (map.values[i] > 0)
            map.values[i] = (float)((scale * (double)map.values[i] + shift) *
                                    (1 + noise * (2 * (double)cn_rng_float(seed, 7, i) - 1)));
    const cn_status status = rgba ? cn_oiio_write_exr(to, rgba, map.values, map.width, map.height, NULL)
                                  : cn_fail(CN_ERR_NOMEM, "out of memory");
    free(rgba);
    free(map.values);
    return status;
}

static cn_status cue(char **argv)
{
    cn_scene scene;
    cn_status status = CN_OK;
    CN_TRY(cn_scene_read_colmap(&scene, argv[0]));
    for (uint32_t i = 0; i < scene.n_views && status == CN_OK; i++)
        status = write_cue(&scene.views[i], i, argv);
    cn_scene_deinit(&scene);
    return status;
}

static cn_status normals(char **argv)
{
    cn_scene scene;
    CN_TRY(cn_scene_read_colmap(&scene, argv[0]));
    cn_status status = CN_OK;
    for (uint32_t i = 0; i < scene.n_views && status == CN_OK; i++)
        status = write_normals(&scene, i, argv);
    cn_scene_deinit(&scene);
    return status;
}

/* ---- lenses ---- */

static cn_status darken(char **argv)
{
    float *rgba;
    uint32_t w, h;
    CN_TRY(cn_oiio_read_rgba(argv[0], &rgba, &w, &h));
    float *rgb = malloc((size_t)w * h * 3 * sizeof *rgb);
    for (size_t i = 0; rgb && i < (size_t)w * h; i++) {
        const double x = ((double)(i % w) + 0.5) / w - 0.5, y = ((double)(i / w) + 0.5) / w - 0.5 * h / w;
        const double squared = 4 * (x * x + y * y) / (1 + (double)h * h / ((double)w * w));
        for (size_t c = 0; c < 3; c++)
            rgb[3 * i + c] = encode(cn_srgb_decode((double)rgba[4 * i + c]) * exp2(-atof(argv[2]) * squared));
    }
    const cn_status status = rgb ? cn_oiio_write_jpeg(argv[1], rgb, w, h, (const cn_oiio_attribute[]){ { 0 } })
                                 : cn_fail(CN_ERR_NOMEM, "out of memory");
    free(rgb);
    free(rgba);
    return status;
}

/* ---- poses ---- */

static void by_chance(uint64_t stream, uint64_t i, double length, double out[3])
{
    for (uint64_t c = 0; c < 3; c++)
        out[c] = (double)cn_rng_float(7, stream, 3 * i + c) - 0.5;
    cn_normalize3(out);
    for (int c = 0; c < 3; c++)
        out[c] *= length;
}

/* Turns a view by a rotation vector of the world's axes, and moves its centre. */
static void displace(cn_view *view, const double turn[3], const double move[3])
{
    const double half = 0.5 * cn_norm3(turn), s = half > 0 ? sin(half) / (2 * half) : 0.5;
    const double quaternion[4] = { cos(half), -s * turn[0], -s * turn[1], -s * turn[2] };
    double back[9], turned[9], centre[3], away[3];
    cn_view_centre(view, centre);
    for (int c = 0; c < 3; c++)
        centre[c] += move[c];
    cn_quat_to_mat3(quaternion, back);
    cn_mat3_mul(view->rotation, back, turned);
    memcpy(view->rotation, turned, sizeof turned);
    cn_mat3_vec(turned, centre, away);
    for (int c = 0; c < 3; c++)
        view->translation[c] = -away[c];
}

static cn_status plant(char **argv)
{
    cn_scene scene;
    CN_TRY(cn_scene_read_colmap(&scene, argv[0]));
    for (uint32_t i = 0; i < scene.n_views; i++) {
        double turn[3], move[3];
        by_chance(1, i, cn_radians(strtod(argv[2], NULL)), turn);
        by_chance(2, i, strtod(argv[3], NULL), move);
        displace(&scene.views[i], turn, move);
    }
    const cn_status status = cn_scene_write_colmap(&scene, argv[1]);
    cn_scene_deinit(&scene);
    return status;
}

/* Mean distance of the views from their truth, after the similarity that brings their centres nearest. */
static cn_status pose_error(const cn_scene *truth, const cn_scene *found, const bool *use, double *turn_deg,
                            double *move_m)
{
    double(*at)[2][3] = calloc(found->n_views + 1u, sizeof *at);
    cn_similarity similarity;
    double(*from)[3] = (double(*)[3])at, (*to)[3] = from + found->n_views;
    uint32_t n = 0;
    if (!at) return cn_fail(CN_ERR_NOMEM, "out of memory");
    for (uint32_t i = 0; i < found->n_views; i++) {
        if (!use[i]) continue;
        cn_view_centre(&found->views[i], from[n]);
        cn_view_centre(&truth->views[i], to[n++]);
    }
    const cn_status status =
        cn_pose_fit_similarity(&(cn_similarity_task){ n, from, to, 1, 1, 1, NULL }, &similarity, NULL);
    *turn_deg = *move_m = 0;
    for (uint32_t i = 0, k = 0; status == CN_OK && i < found->n_views; i++) {
        if (!use[i]) continue;
        double placed[3], back[9], upright[9], turn[9];
        cn_mat3_vec(similarity.rotation, from[k], placed);
        for (int c = 0; c < 3; c++)
            placed[c] = similarity.scale * placed[c] + similarity.translation[c];
        *move_m += cn_distance3(placed, to[k++]) / n;
        cn_mat3_transpose(similarity.rotation, back);
        cn_mat3_mul(found->views[i].rotation, back, upright);
        cn_mat3_transpose(truth->views[i].rotation, back);
        cn_mat3_mul(upright, back, turn);
        *turn_deg += cn_degrees(acos(fmax(-1, fmin(1, (turn[0] + turn[4] + turn[8] - 1) / 2)))) / n;
    }
    free(at);
    return status;
}

/* Applies what the tile learned to the views that it was trained on; rows are turn and move of the photo, then of its
 * run. */
static cn_status refine(const cn_bundle *bundle, cn_scene *scene, bool *use)
{
    const cn_tensor *params = cn_bundle_find(bundle, "effect.pose_refinement.params");
    const cn_tensor *run = cn_bundle_find(bundle, "effect.pose_refinement.constants");
    const char *text = cn_bundle_get(bundle, "conurb.tile");
    json_t *root = text ? json_loads(text, 0, NULL) : NULL;
    const json_t *names = json_object_get(root, "photos"), *half = json_object_get(root, "half_extent_m");
    if (!params || !run || !root) {
        json_decref(root);
        return refuse("the tile has no refined poses");
    }
    double mean = 0;
    for (size_t c = 0; c < 3; c++)
        mean += json_number_value(json_array_get(half, c)) / 3;
    const size_t trained = (size_t)json_integer_value(json_object_get(root, "trained_photos"));
    for (size_t k = 0; k < trained; k++)
        for (uint32_t i = 0; i < scene->n_views; i++) {
            if (strcmp(scene->views[i].name, json_string_value(json_array_get(names, k))) != 0) continue;
            const float *row = (const float *)params->data + 12 * k;
            double w[6];
            for (int c = 0; c < 6; c++)
                w[c] = (double)(row[c] + (((const float *)run->data)[k] > 0 ? row[6 + c] : 0));
            for (int c = 3; c < 6; c++)
                w[c] *= MOVE * mean;
            displace(&scene->views[i], w, w + 3);
            use[i] = true;
        }
    json_decref(root);
    return CN_OK;
}

static cn_status poses_of(const cn_scene *truth, cn_scene *found, const char *tile, bool *use)
{
    double turn[2], move[2];
    cn_bundle *bundle = NULL;
    cn_scene planted;
    if (truth->n_views != found->n_views) return refuse("the models are not of the same photos");
    CN_TRY(cn_bundle_open(&bundle, tile, true));
    planted = *found;
    planted.views = malloc(found->n_views * sizeof *planted.views);
    cn_status status = planted.views ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory");
    if (status == CN_OK) {
        memcpy(planted.views, found->views, found->n_views * sizeof *planted.views);
        status = refine(bundle, found, use);
    }
    if (status == CN_OK) status = pose_error(truth, &planted, use, &turn[0], &move[0]);
    if (status == CN_OK) status = pose_error(truth, found, use, &turn[1], &move[1]);
    if (status == CN_OK)
        printf("planted %.4f deg %.4f m, refined %.4f deg %.4f m\n", turn[0], move[0], turn[1], move[1]);
    free(planted.views);
    cn_bundle_destroy(&bundle);
    return status;
}

static cn_status poses(char **argv)
{
    cn_scene truth, found = { 0 };
    CN_TRY(cn_scene_read_colmap(&truth, argv[0]));
    cn_status status = cn_scene_read_colmap(&found, argv[1]);
    bool *use = status == CN_OK ? calloc(found.n_views + 1u, sizeof *use) : NULL;
    if (status == CN_OK) status = use ? poses_of(&truth, &found, argv[2], use) : cn_fail(CN_ERR_NOMEM, "out of memory");
    free(use);
    cn_scene_deinit(&truth);
    cn_scene_deinit(&found);
    return status;
}

int main(int argc, char **argv)
{
    cn_status status = CN_ERR_USAGE;
    if (argc == 6 && strcmp(argv[1], "relit") == 0)
        status = relit(argv + 2);
    else if (argc == 4 && strcmp(argv[1], "depth") == 0)
        status = depth(argv + 2);
    else if (argc == 6 && strcmp(argv[1], "normals") == 0)
        status = normals(argv + 2);
    else if (argc == 8 && strcmp(argv[1], "cue") == 0)
        status = cue(argv + 2);
    else if (argc == 6 && strcmp(argv[1], "plant") == 0)
        status = plant(argv + 2);
    else if (argc == 5 && strcmp(argv[1], "darken") == 0)
        status = darken(argv + 2);
    else if (argc == 5 && strcmp(argv[1], "poses") == 0)
        status = poses(argv + 2);
    else
        status = refuse("relit, depth, normals, cue, plant, darken or poses, with their files");
    if (status != CN_OK) fprintf(stderr, "compare: %s\n", cn_error_message());
    return status != CN_OK;
}
