#include "splat/seeds.h"

#include "base/clock.h"
#include "base/keys.h"
#include "math/linalg.h"
#include "splat/harmonics.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { ANCESTORS = 3, TRIES = 8, SKY_PIXELS = 6 /* sky: pixels that one Gaussian stands for */ };

#define START_LOGIT 1.0f  /* opacity 0.73 */
#define WIDTH_OF_CUBE 0.6 /* standard deviation along the surface, by the cube's side */
#define THIN 0.2          /* across it, by that along it */
#define REACH 3.0         /* standard deviations within which a Gaussian stands in the way */
#define FAR_QUANTILE 0.995
#define OVERLAP 10.0
#define MAX_JUMP 0.05 /* of the depth, between neighbours on one surface */

/* ---- a pixel's place ---- */

static void ray_of(const cn_target *t, uint32_t pixel, double away[3])
{
    const double *p = t->camera.params;
    double dir[3] = { (pixel % t->camera.width + 0.5 - p[2]) / p[0], (pixel / t->camera.width + 0.5 - p[3]) / p[1], 1 };
    (void)cn_normalize3(dir);
    cn_mat3_tvec(t->view.rotation, dir, away);
}

/* A place on the sphere about the origin, along the ray. */
static double to_sphere(const double eye[3], const double away[3], double radius)
{
    const double along = cn_dot3(eye, away), off = cn_dot3(eye, eye) - radius * radius;
    return -along + sqrt(fmax(along * along - off, 0));
}

bool cn_seed_at(const cn_splat_set *set, const cn_targets *targets, uint32_t target, uint32_t pixel, cn_seed *seed)
{
    const cn_target *t = &targets->list[target];
    double depth = (double)targets->depths[t->depths + pixel], away[3], eye[3];
    if (!(depth > 0)) return false;
    ray_of(t, pixel, away);
    for (int k = 0; k < 3; k++)
        eye[k] = t->eye[k] - set->origin[k];
    const double sphere = to_sphere(eye, away, set->far_m);
    seed->target = target;
    seed->pixel = pixel;
    seed->sky = depth >= sphere;
    depth = fmin(depth, sphere);
    for (int k = 0; k < 3; k++)
        seed->xyz[k] = eye[k] + depth * away[k];
    seed->footprint_m = depth * cn_dot3(away, t->view.rotation + 6) / t->camera.params[0];
    return true;
}

bool cn_seed_is_in_clear(const cn_splat_set *set, const cn_targets *targets, const double xyz[3], double width_m)
{
    double at[3];
    for (int k = 0; k < 3; k++)
        at[k] = set->origin[k] + xyz[k];
    return cn_clear_space_holds(&targets->clear, at, REACH * width_m);
}

/* ---- a pixel's Gaussian ---- */

/* From the pixel to a neighbour on the same surface, along x (0) or y (1). */
static bool step_along(const cn_splat_set *set, const cn_targets *targets, uint32_t target, uint32_t pixel, int axis,
                       double out[3])
{
    const cn_target *t = &targets->list[target];
    const uint32_t width = t->camera.width, at = axis ? pixel / width : pixel % width;
    const uint32_t stride = axis ? width : 1, end = axis ? t->camera.height : width;
    const float *depth = targets->depths + t->depths + pixel;
    cn_seed here, there;
    double best = MAX_JUMP;
    uint32_t nearest = pixel;
    if (at > 0 && fabs((double)(depth[-(ptrdiff_t)stride] / depth[0]) - 1) < best) {
        nearest = pixel - stride;
        best = fabs((double)(depth[-(ptrdiff_t)stride] / depth[0]) - 1);
    }
    if (at + 1 < end && fabs((double)(depth[stride] / depth[0]) - 1) < best) nearest = pixel + stride;
    if (nearest == pixel || !cn_seed_at(set, targets, target, pixel, &here) ||
        !cn_seed_at(set, targets, target, nearest, &there))
        return false;
    for (int k = 0; k < 3; k++)
        out[k] = nearest < pixel ? here.xyz[k] - there.xyz[k] : there.xyz[k] - here.xyz[k];
    return true;
}

/* The surface's normal, or the direction to the eye. */
static void normal_of(const cn_splat_set *set, const cn_targets *targets, uint32_t target, uint32_t pixel, bool sky,
                      double normal[3])
{
    double across[3], down[3];
    if (!sky && step_along(set, targets, target, pixel, 0, across) &&
        step_along(set, targets, target, pixel, 1, down)) {
        cn_cross3(across, down, normal);
        if (cn_normalize3(normal)) return;
    }
    ray_of(&targets->list[target], pixel, normal);
}

/* The shortest turn from the z axis to the normal. */
static void quaternion_to(const double normal[3], float q[4])
{
    const double sign = normal[2] < 0 ? -1 : 1; /* a Gaussian looks the same from behind */
    double turn[4] = { 1 + sign * normal[2], -sign * normal[1], sign * normal[0], 0 };
    const double length = sqrt(turn[0] * turn[0] + turn[1] * turn[1] + turn[2] * turn[2]);
    for (int k = 0; k < 4; k++)
        q[k] = (float)(turn[k] / length);
}

void cn_seed_row(const cn_splat_set *set, const cn_targets *targets, const cn_seed *seed, double width_m, float *row)
{
    const uint32_t target = seed->target, pixel = seed->pixel;
    const cn_target *t = &targets->list[target];
    const uint32_t x = pixel % t->camera.width, y = pixel / t->camera.width;
    const size_t across = (t->camera.width + CN_SPLAT_TILE - 1) / CN_SPLAT_TILE;
    const uint8_t *colour = targets->pictures + t->pixels +
                            (y / CN_SPLAT_TILE * across + x / CN_SPLAT_TILE) * 4 * CN_SPLAT_TILE_PIXELS +
                            y % CN_SPLAT_TILE * CN_SPLAT_TILE + x % CN_SPLAT_TILE;
    double normal[3];
    memset(row, 0, cn_row_length(set->degree) * sizeof *row);
    normal_of(set, targets, target, pixel, seed->sky, normal);
    quaternion_to(normal, row + CN_ROW_ROTATION);
    for (int k = 0; k < 3; k++) {
        row[CN_ROW_CENTRE + k] = (float)seed->xyz[k];
        row[CN_ROW_SCALE + k] = (float)log(width_m * (k < 2 ? 1 : THIN));
        row[CN_ROW_COLOUR + k] = ((float)colour[k * CN_SPLAT_TILE_PIXELS] / 255 - 0.5f) / CN_HARMONICS_0;
    }
    row[CN_ROW_OPACITY] = START_LOGIT;
}

/* ---- where the sky begins ---- */

static int compare(const void *a, const void *b)
{
    const float x = *(const float *)a, y = *(const float *)b;
    return (x > y) - (x < y);
}

static cn_status find_extent(cn_splat_set *set, const cn_targets *targets)
{
    enum { STEP = 61 };
    const size_t all = targets->size[1] / sizeof(float);
    float *depths = malloc((all / STEP + 1) * sizeof *depths);
    size_t n = 0;
    double reach = 0;
    if (!depths) return cn_fail(CN_ERR_NOMEM, "out of memory for depths");
    for (size_t i = 0; i < all; i += STEP)
        if (targets->depths[i] > 0 && isfinite(targets->depths[i])) depths[n++] = targets->depths[i];
    qsort(depths, n, sizeof *depths, compare);
    const double most = n ? (double)depths[(size_t)(FAR_QUANTILE * (double)(n - 1))] : 0;
    free(depths);
    if (!n) return cn_fail(CN_ERR_DATA, "the photos' views show no surface; train longer, or look at the renders");
    for (uint32_t i = 0; i < targets->n; i++)
        for (int k = 0; k < 3; k++)
            set->origin[k] += targets->list[i].eye[k] / targets->n;
    for (int k = 0; k < 3; k++)
        set->origin[k] = round(set->origin[k]);
    for (uint32_t i = 0; i < targets->n; i++)
        reach = fmax(reach, cn_distance3(targets->list[i].eye, set->origin));
    set->far_m = 2 * (reach + most);
    return CN_OK;
}

/* ---- one Gaussian a place ---- */

typedef struct sowing {
    cn_splat_set *set;
    const cn_context *ctx;
    const cn_targets *targets;
    int8_t *levels; /* of each pixel: of its cube, whose side is 2^level metres; -128: nothing is there */
    cn_keys taken;
    size_t n; /* seeds; those past the set's room are only counted */
    double started;
    size_t looked, all; /* pictures gone through in this try, once for each level; of how many */
} sowing;

static double cube_of(const cn_splat_set *set, const cn_seed *seed)
{
    return set->spacing * seed->footprint_m * (seed->sky ? SKY_PIXELS : 1);
}

static uint64_t key_of(const double xyz[3], int level)
{
    int64_t cube[3];
    for (int k = 0; k < 3; k++)
        cube[k] = (int64_t)floor(xyz[k] / ldexp(1, level));
    return cn_keys_of_cube((uint64_t)(level + 200), cube);
}

/* The pixels of one level take their cubes, and mark the larger ones around: coarser pixels leave them alone. */
static cn_status sow_pixel(sowing *s, uint32_t target, uint32_t pixel, int level)
{
    cn_splat_set *set = s->set;
    const double width_m = WIDTH_OF_CUBE * ldexp(1, level);
    cn_seed seed;
    bool fresh;
    if (!cn_seed_at(set, s->targets, target, pixel, &seed)) return CN_OK;
    CN_TRY(cn_keys_add(&s->taken, key_of(seed.xyz, level), 0, &fresh));
    if (!fresh || cn_seed_is_in_clear(set, s->targets, seed.xyz, width_m)) return CN_OK;
    if (s->n < set->room) cn_seed_row(set, s->targets, &seed, width_m, set->rows + s->n * cn_row_length(set->degree));
    s->n++;
    for (int above = 1; above <= ANCESTORS && fresh; above++)
        CN_TRY(cn_keys_add(&s->taken, key_of(seed.xyz, level + above), 0, &fresh));
    return CN_OK;
}

static cn_status sow_level(sowing *s, int level)
{
    for (uint32_t t = 0; t < s->targets->n; t++) {
        const cn_target *target = &s->targets->list[t];
        const int8_t *levels = s->levels + target->depths;
        const uint32_t n = target->camera.width * target->camera.height;
        if (cn_stopping(s->ctx)) return cn_fail(CN_ERR_INTERRUPTED, "stopped while placing splats");
        for (uint32_t i = 0; i < n; i++)
            if (levels[i] == level) CN_TRY(sow_pixel(s, t, i, level));
        const cn_progress_report report = {
            "export", "splats: seeds", (double)++s->looked, (double)s->all, cn_now_s() - s->started, -1, NULL
        };
        cn_progress(s->ctx, &report);
    }
    return CN_OK;
}

static void find_levels(void *user, size_t t, unsigned worker)
{
    (void)worker;
    const sowing *s = user;
    const cn_target *target = &s->targets->list[t];
    for (uint32_t i = 0; i < target->camera.width * target->camera.height; i++) {
        cn_seed seed;
        const bool there = cn_seed_at(s->set, s->targets, (uint32_t)t, i, &seed);
        const double level = there ? floor(log2(cube_of(s->set, &seed))) : -128;
        s->levels[target->depths + i] = (int8_t)fmin(fmax(level, -128), 100);
    }
}

static cn_status sow(sowing *s)
{
    bool there[256] = { 0 };
    cn_pool_run(s->ctx->pool, s->targets->n, find_levels, s);
    for (size_t i = 0; i < s->targets->size[1] / sizeof(float); i++)
        there[s->levels[i] + 128] = true;
    s->n = s->looked = s->all = 0;
    for (int i = 1; i < 256; i++)
        s->all += there[i] ? s->targets->n : 0;
    cn_keys_deinit(&s->taken);
    for (int level = -127; level <= 100; level++)
        if (there[level + 128]) CN_TRY(sow_level(s, level));
    return CN_OK;
}

/* Widens the spacing until all seeds find room. Their number falls with its square. A place is seen in OVERLAP pictures
 * at most, or else the fit adds what is missing. */
static cn_status sow_to_budget(sowing *s)
{
    cn_splat_set *set = s->set;
    const double pixels = (double)s->targets->size[1] / sizeof(float);
    set->spacing = fmax(1, sqrt(pixels / (OVERLAP * (double)set->room)));
    for (int i = 0; i < TRIES; i++) {
        CN_TRY(sow(s));
        const double ratio = (double)s->n / (double)set->room;
        if (ratio <= 1) break;
        set->spacing *= fmax(sqrt(ratio) * 1.02, 1.05);
    }
    set->n = s->n < set->room ? s->n : set->room;
    return set->n ? CN_OK : cn_fail(CN_ERR_DATA, "the photos' views show no surface to put splats on");
}

cn_status cn_seeds_make(cn_splat_set *set, const cn_context *ctx, const cn_targets *targets)
{
    sowing s = { .set = set, .ctx = ctx, .targets = targets, .started = cn_now_s() };
    CN_TRY(find_extent(set, targets));
    s.levels = malloc(targets->size[1] / sizeof(float));
    const cn_status status = s.levels ? sow_to_budget(&s) : cn_fail(CN_ERR_NOMEM, "out of memory for levels");
    cn_keys_deinit(&s.taken);
    free(s.levels);
    return status;
}
