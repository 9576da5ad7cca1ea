/* Tells photos that stand on their side from upright ones. Some cameras and programs store upright photos on their
 * side, and the EXIF that says so gets lost.
 *
 * Whoever walks or flies around something turns about the upright axis, and tilts the camera much less. Then right axes
 * differ, all of them level, and down axes hardly differ. On their side it is the other way round. Where the photos
 * look nearly one way that tells nothing. Then the sky does: it is brighter or bluer than what is opposite. */
#include "pose/align_held.h"

#include "base/file.h"
#include "bridge/oiio.h"
#include "math/linalg.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { FEWEST = 5, FEWEST_READ = 3, LOOKED_AT = 12 };
/* By eigenvalues of the axes' products, as shares of the photos. Sets on their side: 0.285 of down axes and 0.063 of
 * right axes (ET, 9 photos), 0.310 and 0.022 (a walk around a hall, 61). Upright ones have 2.7 (kitchen) to 43 times
 * (herz-jesus) as much of right axes as of down axes, and at most 0.16 of the latter. Where all look one way both are
 * below 0.01. */
#define TURN 0.1  /* of the down axes, at least */
#define TIMES 3   /* as much as the other axes */
#define PLANE 0.1 /* of that share: down axes are in a plane */
/* How much brighter and bluer the outer tenth on one side is than on the other, of display-encoded colours, and by how
 * many of the photos. The hall has 0.57 from left to right, by all photos, and 0.01 from top to bottom; castle, sceaux,
 * lund and sacre-coeur 0.32 to 0.56 from top to bottom, by 0.91 or more. Upright sets have at most 0.23 from side to
 * side (a house, by 0.88). Indoors it may be wrong: fox has -0.48 from top to bottom. */
#define SKIER 0.3
#define AGREE 0.9
#define ACROSS 2 /* times as much across as down */
/* Mean sine of the pitch that tells. With the true side up ET looks down by 0.43, temple47 by 0.14. Not measured apart.
 */
#define LEVEL 0.1

void cn_held_gram(const cn_held *held, int axis, uint32_t without, double gram[9])
{
    memset(gram, 0, 9 * sizeof *gram);
    for (uint32_t i = 0; i < held->n; i++) {
        const double *r = held->rotation[i] + 3 * axis;
        for (int a = 0; a < 9 && !held->left_out[i] && i != without; a++)
            gram[a] += r[a / 3] * r[a % 3];
    }
}

bool cn_held_init(const cn_scene *scene, cn_side up, cn_held *held)
{
    const size_t room = scene->n_views + (size_t)1;
    *held = (cn_held){ scene->n_views, calloc(room, sizeof *held->rotation), calloc(room, sizeof *held->left_out) };
    if (!held->rotation || !held->left_out) return false;
    for (uint32_t i = 0; i < held->n; i++) {
        memcpy(held->rotation[i], scene->views[i].rotation, sizeof held->rotation[i]);
        cn_side_turn(up, held->rotation[i]);
    }
    return true;
}

void cn_held_deinit(cn_held *held)
{
    free(held->rotation);
    free(held->left_out);
    memset(held, 0, sizeof *held);
}

typedef enum told { UPRIGHT, ON_SIDE, UNKNOWN } told;

static told told_by_cameras(const cn_scene *scene)
{
    double gram[9], right[3], down[3], axes[9];
    cn_held held;
    told what = UNKNOWN;
    if (cn_held_init(scene, CN_SIDE_TOP, &held) && held.n >= FEWEST) {
        cn_held_gram(&held, 0, UINT32_MAX, gram);
        cn_eigen_symmetric(3, gram, right, axes);
        cn_held_gram(&held, 1, UINT32_MAX, gram);
        cn_eigen_symmetric(3, gram, down, axes);
        const bool clear = down[1] > TURN * held.n && down[0] < PLANE * down[1];
        if (right[1] > TIMES * down[1]) what = UPRIGHT;
        if (clear && down[1] > TIMES * right[1]) what = ON_SIDE;
    }
    cn_held_deinit(&held);
    return what;
}

/* brighter: how much brighter the left outer tenth of a picture is than the right one. skier: how much more brightness
 * plus blue less red the left one has than the right one, and the upper than the lower. */
typedef struct edges {
    double brighter, skier[2];
} edges;

static void compare_edges(const float *rgba, uint32_t width, uint32_t height, edges *sum)
{
    enum { GRID = 80, EDGE = GRID / 10 };
    for (uint32_t i = 0; i < GRID * GRID; i++) {
        const uint32_t at[2] = { i % GRID, i / GRID };
        const float *p =
            rgba + 4 * ((size_t)((2 * at[1] + 1) * height / (2 * GRID)) * width + (2 * at[0] + 1) * width / (2 * GRID));
        const double red = fmin((double)p[0], 1), green = fmin((double)p[1], 1), blue = fmin((double)p[2], 1),
                     bright = (red + green + blue) / 3;
        for (int a = 0; a < 2; a++) {
            const double sign = at[a] < EDGE ? 1 : at[a] >= GRID - EDGE ? -1 : 0;
            if (a == 0) sum->brighter += sign * bright / (GRID * EDGE);
            sum->skier[a] += sign * (bright + blue - red) / (GRID * EDGE);
        }
    }
}

/* The side of the sky, where most photos have it on their left or right; else the top. brighter: the sky has to be
 * brighter than what is opposite, as the sea beside a coast is not that a flight follows. */
static cn_side side_of_sky(const cn_scene *scene, const cn_photo_index *index, bool brighter)
{
    edges all = { 0 };
    uint32_t n = 0, left = 0;
    const uint32_t step = scene->n_views / LOOKED_AT + 1;
    for (uint32_t i = 0; index->folder && i < scene->n_views; i += step) {
        float *rgba = NULL;
        uint32_t width, height;
        if (scene->views[i].photo >= index->n_photos) continue;
        char *path = cn_path_join(index->folder, index->photos[scene->views[i].photo].name);
        if (path && cn_oiio_read_rgba(path, &rgba, &width, &height) == CN_OK) {
            const double before = all.skier[0];
            compare_edges(rgba, width, height, &all);
            n++;
            left += all.skier[0] > before;
        }
        free(rgba);
        free(path);
    }
    const double across = fabs(all.skier[0]);
    if (n < FEWEST_READ || across < SKIER * n || across < ACROSS * fabs(all.skier[1])) return CN_SIDE_TOP;
    if (brighter && all.brighter * all.skier[0] < 0) return CN_SIDE_TOP;
    if (left >= AGREE * n) return CN_SIDE_LEFT;
    return n - left >= AGREE * n ? CN_SIDE_RIGHT : CN_SIDE_TOP;
}

/* Photos of things, and indoors, look down rather than up. Where they do neither, a phone that is held upright stores
 * its photos with the left side up. */
static cn_side side_that_looks_down(const cn_scene *scene)
{
    double gram[9], values[3], axes[9], right = 0, ahead = 0;
    cn_held held;
    if (cn_held_init(scene, CN_SIDE_TOP, &held)) {
        cn_held_gram(&held, 1, UINT32_MAX, gram);
        cn_eigen_symmetric(3, gram, values, axes);
        for (uint32_t i = 0; i < held.n; i++)
            for (int k = 0; k < 3; k++) {
                right += axes[3 * k] * held.rotation[i][k];
                ahead += axes[3 * k] * held.rotation[i][6 + k];
            }
    }
    const double left_looks_up = right > 0 ? -ahead : ahead;
    const bool looks_up = left_looks_up > LEVEL * held.n;
    cn_held_deinit(&held);
    return looks_up ? CN_SIDE_RIGHT : CN_SIDE_LEFT;
}

cn_side cn_held_find_side(const cn_scene *scene, const cn_photo_index *index)
{
    const told what = told_by_cameras(scene);
    if (what == UPRIGHT) return CN_SIDE_TOP;
    const cn_side side = side_of_sky(scene, index, what == UNKNOWN);
    return what == ON_SIDE && side == CN_SIDE_TOP ? side_that_looks_down(scene) : side;
}
