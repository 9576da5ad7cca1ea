/* The crowd of a photo: cars on the lanes, people on pavements and crossings. */
#include "synth/rig.h"

#include "base/rng.h"
#include "base/units.h"

#include <math.h>
#include <string.h>

enum { STREAM_CROWD = 6 };
typedef struct spot {
    float x, y, room;
} spot;

/* The crowd of one photo. */
enum { MOST = 40 };
typedef struct gathering {
    cn_crowd *crowd;
    const cn_world *world;
    uint32_t photo;
    float about[2]; /* the place that is looked at */
    spot spots[MOST + 1];
    uint32_t n;
} gathering;

static float chance(const gathering *g, uint32_t what, float low, float high)
{
    return low + (high - low) * cn_rng_float(g->world->options.seed, STREAM_CROWD + 16 * (uint64_t)g->photo, what);
}

/* Whether a place is away from the camera and from everybody else. */
static bool fits(const gathering *g, float x, float y, float room)
{
    for (uint32_t i = 0; i < g->n; i++)
        if (hypotf(g->spots[i].x - x, g->spots[i].y - y) < g->spots[i].room + room) return false;
    return true;
}

/* The street nearest to a place, along x or along y. */
static float street_near(const float *axes, uint32_t n, float at)
{
    float best = axes[0];
    for (uint32_t i = 1; i < n; i++)
        if (fabsf(axes[i] - at) < fabsf(best - at)) best = axes[i];
    return best;
}

static void add_car(gathering *g, uint32_t k)
{
    const cn_town *t = &g->world->town;
    const float *about = g->about;
    const bool east = chance(g, k, 0, 1) < 0.5f;
    const float way = chance(g, k + 1, 0, 1) < 0.5f ? 1.0f : -1.0f, away = chance(g, k + 2, -26, 26);
    const float lane = chance(g, k + 3, 0, 1) < 0.3f ? 2.75f : 1.75f;
    float x, y, turn;
    /* Traffic keeps to the right. */
    if (east) {
        x = about[0] + away;
        y = street_near(t->y, t->n_y, about[1]) - way * lane;
        turn = way > 0 ? 0 : (float)CN_PI;
    } else {
        x = street_near(t->x, t->n_x, about[0]) + way * lane;
        y = about[1] + away;
        turn = way > 0 ? 1.57079633f : -1.57079633f;
    }
    if (!cn_town_near(t, x, y, 20) || !fits(g, x, y, 2.6f)) return;
    cn_town_build_car(&g->crowd->mesh, x, y, turn, t->seed + g->photo * 977u + k);
    g->spots[g->n++] = (spot){ x, y, 2.6f };
}

static void add_person(gathering *g, uint32_t k)
{
    const cn_town *t = &g->world->town;
    const float *about = g->about;
    const bool east = chance(g, k, 0, 1) < 0.5f;
    const float away = chance(g, k + 1, -18, 18), across = chance(g, k + 2, -6.4f, 6.4f);
    const float x = east ? about[0] + away : street_near(t->x, t->n_x, about[0]) + across;
    const float y = east ? street_near(t->y, t->n_y, about[1]) + across : about[1] + away;
    const bool on_road =
        fabsf(across) < CN_ROAD_HALF_M ||
        fabsf((east ? x - street_near(t->x, t->n_x, x) : y - street_near(t->y, t->n_y, y))) < CN_ROAD_HALF_M;
    if (!cn_town_near(t, x, y, 10) || cn_town_roof(t, x, y, 0.4f) > 0 || cn_town_clearance(t, x, y) < 0.6f) return;
    if (!fits(g, x, y, 0.45f)) return;
    cn_town_build_person(&g->crowd->mesh, x, y, on_road ? 0 : CN_WALK_HEIGHT_M, chance(g, k + 3, 0, 6.28f),
                         t->seed + g->photo * 977u + k);
    g->spots[g->n++] = (spot){ x, y, 0.45f };
}

cn_status cn_crowd_init(cn_crowd *crowd, const cn_world *w, const cn_shot *shot, uint32_t photo)
{
    memset(crowd, 0, sizeof *crowd);
    if (w->options.plain) return CN_OK;
    const bool air = shot->camera == CN_RIG_AERIAL;
    /* The crowd is around the place that the camera looks at; from the air, where the view meets the ground. */
    const double *z = shot->rotation + 6;
    const double ahead = air && z[2] < 0 ? fmin(80, -shot->centre[2] / z[2]) : 11;
    gathering g = {
        .crowd = crowd,
        .world = w,
        .photo = photo,
        .about = { (float)(shot->centre[0] + ahead * z[0]), (float)(shot->centre[1] + ahead * z[1]) },
        .spots = { { (float)shot->centre[0], (float)shot->centre[1], 3.2f } },
        .n = 1,
    };
    const uint32_t cars = 2 + (uint32_t)chance(&g, 0, 0, 5), people = 4 + (uint32_t)chance(&g, 1, 0, 9);
    for (uint32_t i = 0; i < cars; i++)
        add_car(&g, 10 + 5 * i);
    for (uint32_t i = 0; i < people; i++)
        add_person(&g, 200 + 5 * i);
    if (crowd->mesh.full) {
        cn_crowd_deinit(crowd);
        return cn_fail(CN_ERR_NOMEM, "out of memory for the people in photo %s", shot->name);
    }
    const cn_status status = cn_tracer_create(&crowd->tracer, w->device, &crowd->mesh);
    if (status != CN_OK) cn_crowd_deinit(crowd);
    return status;
}

void cn_crowd_deinit(cn_crowd *crowd)
{
    cn_tracer_destroy(&crowd->tracer);
    cn_mesh_deinit(&crowd->mesh);
}
