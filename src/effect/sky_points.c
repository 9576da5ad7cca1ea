#include "effect/sky_points.h"

#include "effect/sky_grid.h"
#include "math/linalg.h"
#include "pose/lens.h"

#include <stdlib.h>
#include <string.h>

enum {
    X = CN_SKY_HINT_X,
    Y = CN_SKY_HINT_Y,
    N = CN_SKY_HINTS,
    MIN_TRACK = 3, /* views that a point needs, of three photos or more; wrong matches across clouds have fewer */
    /* Points that a photo does not see itself count where so many lie within so many hints: a single wrong one would
     * end the sky of a column. Found on lund. */
    CROWD = 3,
    CROWD_REACH = 4
};

static bool hint_of(const cn_camera *camera, double x_px, double y_px, uint16_t at[2])
{
    const double x = x_px * X / camera->width, y = y_px * Y / camera->height;
    if (!(x >= 0 && y >= 0 && x < X && y < Y)) return false;
    at[0] = (uint16_t)x;
    at[1] = (uint16_t)y;
    return true;
}

void cn_sky_points_deinit(cn_sky_points *points)
{
    free(points->first);
    free(points->seen);
    free(points->shown);
}

bool cn_sky_points_find(const cn_scene *scene, const cn_plan_tile *tile, cn_sky_points *points)
{
    bool *in_tile = calloc(scene->n_views + 1u, sizeof *in_tile);
    *points = (cn_sky_points){ .first = calloc(scene->n_views + 2u, sizeof *points->first),
                               .seen = malloc(sizeof *points->seen * (scene->n_observations + 1u)),
                               .shown = malloc(sizeof *points->shown * (scene->n_points + 1u)) };
    const bool room = in_tile && points->first && points->seen && points->shown;
    const uint32_t min_track = tile->n_photos < MIN_TRACK ? 2 : MIN_TRACK;
    for (uint32_t p = 0; room && p < tile->n_photos; p++)
        in_tile[tile->photos[p]] = true;
    for (int pass = 0; pass < 2 && room; pass++) {
        for (uint32_t p = 0; p < scene->n_points; p++) {
            const cn_point *point = &scene->points[p];
            bool shown = false;
            for (uint32_t i = 0; point->n_observations >= min_track && i < point->n_observations; i++) {
                const cn_observation *o = &scene->observations[point->first_observation + i];
                uint16_t at[2];
                shown |= in_tile[o->view];
                if (!hint_of(&scene->cameras[scene->views[o->view].camera], (double)o->x_px, (double)o->y_px, at))
                    continue;
                if (pass == 0) points->first[o->view + 2]++;
                if (pass == 1) memcpy(points->seen[points->first[o->view + 1]++], at, sizeof at);
            }
            if (pass == 0 && shown) points->shown[points->n_shown++] = p;
        }
        for (uint32_t v = 0; pass == 0 && v < scene->n_views; v++)
            points->first[v + 2] += points->first[v + 1];
    }
    free(in_tile);
    return room;
}

bool cn_sky_points_any(const cn_sky_points *points, uint32_t view)
{
    return points->first[view] < points->first[view + 1];
}

/* Points in the hints around `at`; stops at CROWD. */
static int crowd(const uint8_t *count, int at)
{
    const int x = at % X, y = at / X;
    int n = 0;
    for (int j = y - CROWD_REACH; j <= y + CROWD_REACH && n < CROWD; j++)
        for (int k = x - CROWD_REACH; k <= x + CROWD_REACH; k++)
            if (j >= 0 && k >= 0 && j < Y && k < X) n += count[j * X + k];
    return n;
}

void cn_sky_points_mark(const cn_sky_points *points, const cn_scene *scene, uint32_t view, uint8_t *on)
{
    const cn_view *v = &scene->views[view];
    const cn_camera *camera = &scene->cameras[v->camera];
    const cn_lens_view lens = cn_lens_unpack(camera);
    uint8_t count[N] = { 0 }; /* as far as CROWD */
    for (uint32_t i = 0; i < points->n_shown; i++) {
        double in_camera[3], px[2];
        uint16_t at[2];
        cn_mat3_vec(v->rotation, scene->points[points->shown[i]].xyz, in_camera);
        for (int a = 0; a < 3; a++)
            in_camera[a] += v->translation[a];
        if (!cn_lens_project(&lens, in_camera, px) || !hint_of(camera, px[0], px[1], at)) continue;
        if (count[at[1] * X + at[0]] < CROWD) count[at[1] * X + at[0]]++;
    }
    for (int i = 0; i < N; i++)
        on[i] = count[i] && crowd(count, i) >= CROWD;
    for (uint32_t i = points->first[view]; i < points->first[view + 1]; i++)
        on[points->seen[i][1] * X + points->seen[i][0]] = 1;
}
