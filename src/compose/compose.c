#include "conurb/compose.h"

#include <math.h>
#include <string.h>

/* Not measured apart. */
#define FLOOR 0.01    /* tiles with less than this fraction of the largest weight are not rendered */
#define FADE 0.1      /* fraction of the reach over which the last tile fades out */
#define SATURATE 0.25 /* fraction of the largest excess above which a tile has its full weight */
#define BLIND 0.01    /* fraction of a view that counts as almost nothing */

static const char *const names[] = { "nearest", "distance_2d", "distance_3d", "visibility", "ownership" };

const char *cn_blend_name(cn_blend blend)
{
    return names[blend];
}

cn_status cn_blend_parse(const char *name, cn_blend *blend)
{
    for (size_t i = 0; i < sizeof names / sizeof *names; i++)
        if (strcmp(name, names[i]) == 0) {
            *blend = (cn_blend)i;
            return CN_OK;
        }
    return cn_fail(CN_ERR_USAGE,
                   "there is no blend '%s'; give nearest, distance_2d, distance_3d, visibility or ownership", name);
}

cn_compose_options cn_compose_options_default(void)
{
    return (cn_compose_options){
        .scheme = CN_BLEND_DISTANCE_2D, .exponent = 4, .reach = 2, .max_tiles = 4, .min_visibility = 0.05
    };
}

double cn_compose_radius(double radius_m, double farthest_m, const cn_compose_options *o)
{
    return fmax(radius_m, farthest_m / ((1 - FADE) * o->reach));
}

void cn_compose_weights(uint32_t n, const double *distance_m, double exponent, double *weight)
{
    double smallest = INFINITY, sum = 0;
    for (uint32_t i = 0; i < n; i++)
        if (isfinite(distance_m[i])) smallest = fmin(smallest, fmax(distance_m[i], 0));
    for (uint32_t i = 0; i < n; i++) {
        double d = fmax(distance_m[i], 0); /* read before weight[i] is written: they may be the same array */
        /* The ratio is in [0,1], and exactly 1 for the nearest, so the sum is never 0. */
        weight[i] = isfinite(distance_m[i]) ? pow(d == smallest ? 1 : smallest / d, exponent) : 0;
        sum += weight[i];
    }
    for (uint32_t i = 0; i < n && sum > 0; i++)
        weight[i] /= sum;
}

static double smooth(double x)
{
    x = fmin(fmax(x, 0), 1);
    return x * x * (3 - 2 * x);
}

/* Inserts a tile into the list of the largest weights so far (at most max). */
static void insert(cn_compose_choice *c, uint32_t max, uint32_t tile, double weight)
{
    uint32_t at = c->n;
    while (at > 0 && weight > c->weight[at - 1])
        at--;
    if (at == max) return;
    if (c->n < max) c->n++;
    for (uint32_t i = c->n - 1; i > at; i--) {
        c->tile[i] = c->tile[i - 1];
        c->weight[i] = c->weight[i - 1];
    }
    c->tile[at] = tile;
    c->weight[at] = weight;
}

static void drop_weightless(cn_compose_choice *c)
{
    uint32_t kept = 0;
    for (uint32_t i = 0; i < c->n; i++)
        if (c->weight[i] > 0) {
            c->tile[kept] = c->tile[i];
            c->weight[kept++] = c->weight[i];
        }
    c->n = kept;
}

static void normalise(cn_compose_choice *c)
{
    double sum = 0;
    for (uint32_t i = 0; i < c->n; i++)
        sum += c->weight[i];
    for (uint32_t i = 0; i < c->n && sum > 0; i++)
        c->weight[i] /= sum;
}

/* Subtracts the largest weight that is left out. The last chosen tile then has weight 0 when another one replaces it,
 * so the picture does not jump. When nothing would be left, more tiles are equally far than max: they share. */
static void subtract(cn_compose_choice *c, double left_out, double floor)
{
    const double most = c->n ? c->weight[0] : 0, less = fmax(left_out, floor * most);
    if (!(most > less)) return;
    for (uint32_t i = 0; i < c->n; i++)
        c->weight[i] = fmax(c->weight[i] - less, 0);
    drop_weightless(c);
}

static bool by_picture(cn_blend scheme)
{
    return scheme == CN_BLEND_NEAREST || scheme == CN_BLEND_DISTANCE_2D;
}

/* A tile's weight before the subtraction. */
static double raw_weight(const cn_compose_options *o, double d, double smallest, double reach)
{
    const double u = d / reach, fade = (1 - u * u) * (1 - u * u);
    return o->scheme == CN_BLEND_DISTANCE_2D ? fade * pow(d == smallest ? 1 : smallest / d, o->exponent) : fade;
}

static double distance(const double centre[3], const double camera[3])
{
    return hypot(camera[0] - centre[0], camera[1] - centre[1]);
}

/* What a camera has around it, of the tiles in reach. INFINITY where there is none. */
typedef struct surroundings {
    double smallest; /* distance */
    double part;     /* the smallest ratio of distance to reach */
    uint32_t nearest;
} surroundings;

static surroundings look_around(uint32_t n, const double (*centre)[3], const double *radius_m, const double camera[3],
                                double reach)
{
    surroundings s = { INFINITY, INFINITY, 0 };
    for (uint32_t i = 0; i < n; i++) {
        const double d = distance(centre[i], camera), r = reach * radius_m[i];
        if (!(d < r)) continue;
        s.part = fmin(s.part, d / r);
        if (!(d < s.smallest)) continue;
        s.smallest = d;
        s.nearest = i;
    }
    return s;
}

void cn_compose_choose(uint32_t n_tiles, const double (*centre)[3], const double *radius_m, const double camera[3],
                       const cn_compose_options *o, cn_compose_choice *c)
{
    const uint32_t max = o->max_tiles < CN_COMPOSE_MAX ? o->max_tiles : CN_COMPOSE_MAX;
    const surroundings near = look_around(n_tiles, centre, radius_m, camera, o->reach);
    *c = (cn_compose_choice){ 0 };
    if (!isfinite(near.smallest) || max == 0) return;
    c->coverage = smooth((1 - near.part) / FADE);
    if (o->scheme == CN_BLEND_NEAREST) {
        insert(c, 1, near.nearest, 1);
        return;
    }
    for (uint32_t i = 0; i < n_tiles; i++) {
        const double d = distance(centre[i], camera), reach = o->reach * radius_m[i];
        if (d < reach) insert(c, max + 1, i, raw_weight(o, d, near.smallest, reach));
    }
    const double left_out = c->n > max ? c->weight[max] : 0;
    if (c->n > max) c->n = max;
    subtract(c, left_out, by_picture(o->scheme) ? FLOOR : 0);
    if (by_picture(o->scheme)) {
        normalise(c);
        return;
    }
    const double most = c->weight[0];
    for (uint32_t i = 0; i < c->n; i++)
        c->weight[i] = smooth(c->weight[i] / (SATURATE * most));
    drop_weightless(c);
}

bool cn_compose_wants_visibility(const cn_compose_choice *choice, const cn_compose_options *o)
{
    return choice->n > 1 && (o->scheme == CN_BLEND_VISIBILITY || o->min_visibility > 0);
}

void cn_compose_see(cn_compose_choice *c, const double *visibility, const cn_compose_options *o)
{
    double most = 0;
    for (uint32_t i = 0; i < c->n; i++)
        most = fmax(most, visibility[i]);
    for (uint32_t i = 0; i < c->n; i++) {
        const double part = (visibility[i] + BLIND) / (most + BLIND);
        if (o->scheme == CN_BLEND_VISIBILITY) c->weight[i] *= part;
        if (o->min_visibility > 0) c->weight[i] *= smooth(part / o->min_visibility - 1);
    }
    drop_weightless(c);
    /* Keep the order by weight. */
    cn_compose_choice sorted = { .coverage = c->coverage };
    for (uint32_t i = 0; i < c->n; i++)
        insert(&sorted, CN_COMPOSE_MAX, c->tile[i], c->weight[i]);
    *c = sorted;
    if (by_picture(o->scheme) || o->scheme == CN_BLEND_VISIBILITY) normalise(c);
}
