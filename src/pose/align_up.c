/* Finds the up direction from the cameras. People and drones hold cameras level, so the cameras' right axes are
 * horizontal: up is the direction most perpendicular to all of them. When they are all parallel (a straight track), up
 * is known only to lie in a plane. If the cameras move forwards, up is also perpendicular to the track, whether they
 * look ahead, down or between. If they move sideways, up is upright along a wall, or else the pictures' own up. */
#include "math/linalg.h"
#include "pose/align_up.h"
#include "pose/similarity.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define NADIR_COSINE 0.9396926207859084 /* 20 degrees */
#define SAME_WAY_UP 0.7071067811865476  /* 45 degrees */
#define MOST 0.6                        /* of the photos. Like the angle above not measured apart */
#define FACES 0.5        /* sine of the angle between a wall's normal and the right axis: the photos look at the wall */
#define ASKEW_RAD 0.0087 /* half a degree: what all photos of a set may be held askew alike. Not measured */
#define FLAT_SHARE 0.5   /* relief divided by camera height above which perspective determines the focal length */

static void remove_along(double v[3], const double axis[3])
{
    double along = cn_dot3(v, axis);
    for (int k = 0; k < 3; k++)
        v[k] -= along * axis[k];
}

/* The main axis of the camera centres; false when they are not on a line. */
static bool track_axis(const cn_scene *scene, double track[3])
{
    double(*centres)[3] = calloc(scene->n_views + (size_t)1, sizeof *centres), deviation[3], axes[9];
    if (!centres) return false;
    for (uint32_t i = 0; i < scene->n_views; i++)
        cn_view_centre(&scene->views[i], centres[i]);
    cn_spread(scene->n_views, (const double(*)[3])centres, NULL, deviation, axes);
    free(centres);
    for (int k = 0; k < 3; k++)
        track[k] = axes[3 * k + 2];
    return deviation[1] < 0.2 * deviation[2];
}

/* The direction to which most pictures' down is near; false where there is none. Pictures that stand on their side or
 * on their head are then left out: photos lose the EXIF that says how they were held. Two of ten such photos made a
 * street look like a view from the air. */
static bool most_agree(const cn_held *held, double down[3])
{
    uint32_t n = 0;
    memset(down, 0, 3 * sizeof *down);
    for (uint32_t i = 0; i < held->n; i++)
        for (int k = 0; k < 3; k++)
            down[k] += held->rotation[i][3 + k];
    if (!cn_normalize3(down)) return false;
    for (uint32_t i = 0; i < held->n; i++)
        n += cn_dot3(held->rotation[i] + 3, down) > SAME_WAY_UP;
    return n >= MOST * held->n;
}

/* Whether the right axes are all parallel, by the eigenvalues of that matrix. */
static bool are_one_way(const double values[3])
{
    return !(values[1] > 0.02 * values[2]);
}

/* Leaves out photos that turn the axis most perpendicular to the right axes by more than this, each on its own. Where
 * all photos look nearly one way, it is the tilt of a single photo that decides, not the directions of view. One of
 * five photos of a front, tilted by 25 degrees, made the others look down: without it the axis turns by 37 degrees. In
 * thirteen other sets of 10 to 40 photos no photo turns it by more than 2.4. False: too many of them decide. */
#define DECIDES 0.9659258262890683 /* cosine of 15 degrees */
#define TILTED 0.2588190451025207  /* sine of 15 degrees */
static bool leave_out_tilted(cn_held *held)
{
    enum { FEW = 200 }; /* among more photos, one does not decide */
    double gram[9], values[3], axes[9], others[9];
    for (uint32_t n = 0; held->n <= FEW && n < (1 - MOST) * held->n; n++) {
        cn_held_gram(held, 0, UINT32_MAX, gram);
        cn_eigen_symmetric(3, gram, values, axes);
        if (are_one_way(values)) return true;
        double least = DECIDES;
        uint32_t tilted = UINT32_MAX;
        for (uint32_t i = 0; i < held->n; i++) {
            if (held->left_out[i]) continue;
            cn_held_gram(held, 0, i, gram);
            cn_eigen_symmetric(3, gram, values, others);
            const double same = fabs(axes[0] * others[0] + axes[3] * others[3] + axes[6] * others[6]);
            if (same < least) least = same, tilted = i;
        }
        if (tilted == UINT32_MAX) return true;
        held->left_out[tilted] = true;
    }
    return held->n > FEW;
}

static void leave_out_turned(cn_held *held)
{
    double way[3];
    const bool agree = most_agree(held, way);
    for (uint32_t i = 0; i < held->n; i++)
        held->left_out[i] = agree && cn_dot3(held->rotation[i] + 3, way) <= SAME_WAY_UP;
}

/* Of the photos that count. down: sum of the cameras' y axes; ahead: of their z axes; right: the main one of their x
 * axes; across: the one most perpendicular to these; one_way: x axes are all parallel. */
typedef struct camera_axes {
    double down[3], ahead[3], right[3], across[3];
    bool one_way;
} camera_axes;

static void find_axes(const cn_held *held, camera_axes *found)
{
    double gram[9], values[3], axes[9];
    memset(found, 0, sizeof *found);
    for (uint32_t i = 0; i < held->n; i++)
        for (int k = 0; k < 3 && !held->left_out[i]; k++) {
            found->down[k] += held->rotation[i][3 + k];
            found->ahead[k] += held->rotation[i][6 + k];
        }
    cn_held_gram(held, 0, UINT32_MAX, gram);
    cn_eigen_symmetric(3, gram, values, axes);
    for (int k = 0; k < 3; k++) {
        found->across[k] = axes[3 * k];
        found->right[k] = axes[3 * k + 2];
    }
    found->one_way = are_one_way(values);
}

/* Makes up level with a wall, where the right axis is too. */
static void stand_on_wall(const cn_scene *scene, const double right[3], double up[3])
{
    double normal[3], upright[3];
    if (!cn_align_wall(scene, up, normal)) return;
    cn_cross3(normal, right, upright);
    if (cn_norm3(upright) < FACES || !cn_normalize3(upright)) return;
    const double side = cn_dot3(upright, up) < 0 ? -1 : 1;
    for (int k = 0; k < 3; k++)
        up[k] = side * upright[k];
}

static bool up_of_track(const cn_scene *scene, const camera_axes *axes, double up[3])
{
    double track[3];
    bool forwards = track_axis(scene, track) && fabs(cn_dot3(track, axes->right)) < 0.5;
    for (int k = 0; k < 3; k++)
        up[k] = forwards ? -axes->down[k] - axes->ahead[k] : -axes->down[k];
    remove_along(up, axes->right);
    if (forwards) {
        remove_along(track, axes->right);
        if (!cn_normalize3(track)) return false;
        remove_along(up, track);
    }
    if (!(cn_norm3(up) > 0.05 * scene->n_views && cn_normalize3(up))) return false;
    if (!forwards) stand_on_wall(scene, axes->right, up);
    return true;
}

/* The pictures' own up: first of all photos, then of those that are level by it. */
static bool own_up(const cn_scene *scene, cn_held *held, double up[3])
{
    camera_axes axes;
    double first[3];
    leave_out_turned(held);
    find_axes(held, &axes);
    if (!up_of_track(scene, &axes, first)) return false;
    for (uint32_t i = 0; i < held->n; i++) {
        const double *r = held->rotation[i], pitch = cn_dot3(r + 6, first);
        held->left_out[i] |= fabs(cn_dot3(r, first)) > TILTED * sqrt(fmax(1 - pitch * pitch, 0)); /* in the picture */
    }
    find_axes(held, &axes);
    if (!up_of_track(scene, &axes, up)) memcpy(up, first, sizeof first); /* none is level */
    return true;
}

/* Gives the axis most perpendicular to the right axes its side. */
static bool up_of_right_axes(const cn_held *held, const camera_axes *axes, double up[3])
{
    memcpy(up, axes->across, sizeof axes->across);
    /* Up is -y for street cameras, and -z for cameras that look down, whose -y is only a heading. */
    double side = -cn_dot3(up, axes->down) - cn_dot3(up, axes->ahead);
    for (int k = 0; k < 3 && side < 0.0; k++)
        up[k] = -up[k];
    return fabs(side) > 0.05 * held->n;
}

static bool up_of(const cn_scene *scene, cn_held *held, double up[3])
{
    camera_axes axes;
    leave_out_turned(held);
    if (!leave_out_tilted(held)) return own_up(scene, held, up);
    find_axes(held, &axes);
    return axes.one_way ? up_of_track(scene, &axes, up) : up_of_right_axes(held, &axes, up);
}

bool cn_align_up(const cn_scene *scene, cn_side side, double up[3])
{
    cn_held held;
    const bool found = cn_held_init(scene, side, &held) && up_of(scene, &held, up);
    cn_held_deinit(&held);
    return found;
}

/* Three standard deviations of a normal distribution, for n > 3 photos that also tell the two angles of up: the
 * quantile of Student's distribution by its series (Abramowitz and Stegun 26.7.5). */
static double three_deviations(uint32_t n)
{
    const double free = (double)n - 2;
    return 3 + 7.5 / free + 17.25 / (free * free);
}

/* Each photo's right axis turns the least eigenvector by what it holds of it. To first order the turn about another
 * eigenvector is their product over the gap of the eigenvalues, and photos are held askew each in its own way. */
static cn_up_error error_of(const cn_held *held)
{
    double gram[9], values[3], axes[9], square = 0;
    uint32_t n = 0;
    cn_held_gram(held, 0, UINT32_MAX, gram);
    cn_eigen_symmetric(3, gram, values, axes);
    for (uint32_t i = 0; i < held->n; i++) {
        const double *r = held->rotation[i];
        if (held->left_out[i]) continue;
        const double least = r[0] * axes[0] + r[1] * axes[3] + r[2] * axes[6];
        n++;
        for (int k = 1; k < 3; k++) {
            const double along = r[0] * axes[k] + r[1] * axes[3 + k] + r[2] * axes[6 + k];
            const double turn = least * along / (values[k] - values[0]);
            square += turn * turn;
        }
    }
    return (cn_up_error){ hypot(ASKEW_RAD, sqrt(square)),
                          n > 3 ? hypot(3 * ASKEW_RAD, three_deviations(n) * sqrt(square)) : INFINITY };
}

bool cn_align_up_clear(const cn_scene *scene, double up[3], cn_up_error *error)
{
    bool found = false;
    camera_axes axes;
    cn_held held;
    if (cn_held_init(scene, CN_SIDE_TOP, &held)) {
        leave_out_turned(&held);
        if (leave_out_tilted(&held)) {
            find_axes(&held, &axes);
            found = !axes.one_way && up_of_right_axes(&held, &axes, up);
            if (found) *error = error_of(&held);
        }
    }
    cn_held_deinit(&held);
    return found;
}

static int compare_doubles(const void *a, const void *b)
{
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

/* The range of the middle 80 % of the points' heights, compared with the cameras' height above the median. */
static bool is_flat(const cn_scene *scene)
{
    enum { FEWEST = 20 };
    uint32_t n = scene->n_points;
    double camera = 0.0, *heights = n < FEWEST ? NULL : malloc(n * sizeof *heights);
    if (!heights) return true; /* the relief is unknown: warn, to be safe */
    for (uint32_t i = 0; i < n; i++)
        heights[i] = scene->points[i].xyz[2];
    qsort(heights, n, sizeof *heights, compare_doubles);
    double relief = heights[n - 1 - n / 10] - heights[n / 10], ground = heights[n / 2];
    free(heights);
    for (uint32_t i = 0; i < scene->n_views; i++) {
        double centre[3];
        cn_view_centre(&scene->views[i], centre);
        camera += centre[2] / scene->n_views;
    }
    return relief < FLAT_SHARE * (camera - ground);
}

bool cn_align_is_nadir(const cn_scene *scene)
{
    for (uint32_t i = 0; i < scene->n_views; i++)
        if (!(-scene->views[i].rotation[8] > NADIR_COSINE)) return false;
    return scene->n_views > 0 && is_flat(scene);
}
