/* Sparse points, as if found by structure from motion without fault: places of the city that several photos show, and
 * in each the pixel where it does, people and cars being in the way or not. */
#include "synth/truth.h"

#include "base/rng.h"
#include "math/linalg.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* A photo does not observe a point from more than five times, or less than a fifth of, the distance of the photo that
 * it was picked in. */
enum { STREAM_POINTS = 9, A_PHOTO = 60, FEWEST = 3, FARTHER = 5 };
#define MOST_PAIRS 4e6 /* of photos and points: large cities get fewer points a photo, not more time */
#define FARTHEST_M 120.0

typedef struct place {
    double xyz[3], distance_m;
    uint8_t rgb[3];
} place;
typedef struct survey {
    const cn_world *world;
    const cn_rig *rig;
    place *places;
    uint32_t n_places;
    cn_observation **seen; /* of each photo: as many as it shows */
    uint32_t *n_seen, **which;
} survey;

static bool blocked(const cn_tracer *tracer, const double from[3], const double to[3])
{
    double way[3];
    for (int a = 0; a < 3; a++)
        way[a] = to[a] - from[a];
    return tracer && cn_tracer_blocked(tracer, from, way, 1 - 1e-4);
}

static uint8_t code(double light)
{
    return (uint8_t)lround(255 * pow(fmin(fmax(light, 0), 1), 1 / 2.2));
}

/* Picks a random pixel of a photo; false when it shows the sky, people or cars, or something very far. */
static bool pick(const survey *s, uint32_t i, const cn_crowd *crowd, uint64_t draw, place *out)
{
    const cn_shot *shot = &s->rig->shots[i];
    const cn_camera *camera = &s->rig->cameras[shot->camera];
    const uint64_t seed = s->world->options.seed, stream = STREAM_POINTS + 16 * (uint64_t)i;
    double d[3];
    cn_ray_query q = { .cone = 1e-3f, .jitter = { 0.5f, 0.5f } };
    cn_ray_answer answer;
    if (cn_camera_unproject(camera, camera->width * (double)cn_rng_float(seed, stream, 2 * draw),
                            camera->height * (double)cn_rng_float(seed, stream, 2 * draw + 1), d) != CN_OK)
        return false;
    memcpy(q.origin, shot->centre, sizeof q.origin);
    cn_mat3_tvec(shot->rotation, d, q.direction);
    cn_world_look(s->world, shot->run, crowd, &q, &answer);
    if (answer.disturbed || !(answer.distance_m > 0 && answer.distance_m < FARTHEST_M)) return false;
    out->distance_m = answer.distance_m;
    for (int a = 0; a < 3; a++) {
        out->xyz[a] = shot->centre[a] + answer.distance_m * q.direction[a];
        out->rgb[a] = code(shot->gain * (double)answer.clean[a]);
    }
    return true;
}

/* Whether the photo shows the place, and where. */
static bool shows(const survey *s, uint32_t i, const cn_crowd *crowd, const place *p, cn_observation *at)
{
    const cn_shot *shot = &s->rig->shots[i];
    const cn_camera *camera = &s->rig->cameras[shot->camera];
    const double distance = cn_distance3(shot->centre, p->xyz);
    double cam[3], pixel[2];
    if (distance > FARTHER * p->distance_m || FARTHER * distance < p->distance_m) return false;
    cn_mat3_vec(shot->rotation, p->xyz, cam);
    for (int a = 0; a < 3; a++)
        cam[a] += shot->translation[a];
    if (!cn_camera_project(camera, cam, pixel)) return false;
    if (!(pixel[0] >= 1 && pixel[0] <= camera->width - 1 && pixel[1] >= 1 && pixel[1] <= camera->height - 1))
        return false;
    if (blocked(s->world->tracer, shot->centre, p->xyz) || blocked(crowd->tracer, shot->centre, p->xyz)) return false;
    *at = (cn_observation){ i, (float)pixel[0], (float)pixel[1] };
    return true;
}

static cn_status look_for_all(survey *s, uint32_t i, const cn_crowd *crowd)
{
    s->seen[i] = malloc(s->n_places * sizeof *s->seen[i]);
    s->which[i] = malloc(s->n_places * sizeof *s->which[i]);
    if (!s->seen[i] || !s->which[i]) return cn_fail(CN_ERR_NOMEM, "out of memory for %u points", s->n_places);
    for (uint32_t k = 0; k < s->n_places; k++)
        if (shows(s, i, crowd, &s->places[k], &s->seen[i][s->n_seen[i]])) s->which[i][s->n_seen[i]++] = k;
    /* Most photos show few of all points. */
    cn_observation *seen = realloc(s->seen[i], (s->n_seen[i] + 1u) * sizeof *seen);
    uint32_t *which = realloc(s->which[i], (s->n_seen[i] + 1u) * sizeof *which);
    if (seen) s->seen[i] = seen;
    if (which) s->which[i] = which;
    return CN_OK;
}

/* First the points, then their observations: both need the photo's crowd. */
static cn_status visit(survey *s, bool picking, uint32_t a_photo)
{
    for (uint32_t i = 0; i < s->rig->n_shots; i++) {
        cn_crowd crowd;
        CN_TRY(cn_crowd_init(&crowd, s->world, &s->rig->shots[i], i));
        cn_status status = CN_OK;
        for (uint64_t draw = 0; picking && draw < a_photo; draw++)
            s->n_places += pick(s, i, &crowd, draw, &s->places[s->n_places]);
        if (!picking) status = look_for_all(s, i, &crowd);
        cn_crowd_deinit(&crowd);
        CN_TRY(status);
    }
    return CN_OK;
}

/* From lists by photo to tracks by point. */
static cn_status gather(const survey *s, cn_scene *scene)
{
    uint32_t *count = calloc(s->n_places + 1u, sizeof *count);
    uint64_t total = 0;
    for (uint32_t i = 0; i < s->rig->n_shots && count; i++)
        for (uint32_t k = 0; k < s->n_seen[i]; k++)
            count[s->which[i][k]]++;
    for (uint32_t k = 0; k < s->n_places && count; k++)
        total += count[k];
    scene->points = malloc((s->n_places + 1u) * sizeof *scene->points);
    scene->observations = malloc((total + 1) * sizeof *scene->observations);
    if (!count || !scene->points || !scene->observations) {
        free(count);
        return cn_fail(CN_ERR_NOMEM, "out of memory for %u points", s->n_places);
    }
    for (uint32_t k = 0; k < s->n_places; k++) {
        const bool kept = count[k] >= FEWEST;
        cn_point *p = &scene->points[scene->n_points];
        if (!kept) {
            count[k] = UINT32_MAX;
            continue;
        }
        *p = (cn_point){ .first_observation = (uint32_t)scene->n_observations };
        memcpy(p->xyz, s->places[k].xyz, sizeof p->xyz);
        memcpy(p->rgb, s->places[k].rgb, sizeof p->rgb);
        scene->n_observations += count[k];
        count[k] = scene->n_points++;
    }
    for (uint32_t i = 0; i < s->rig->n_shots; i++)
        for (uint32_t k = 0; k < s->n_seen[i]; k++) {
            if (count[s->which[i][k]] == UINT32_MAX) continue;
            cn_point *p = &scene->points[count[s->which[i][k]]];
            scene->observations[p->first_observation + p->n_observations++] = s->seen[i][k];
        }
    free(count);
    return CN_OK;
}

cn_status cn_truth_points(const cn_world *world, const cn_rig *rig, cn_scene *scene)
{
    const uint32_t n = rig->n_shots;
    const uint32_t a_photo = (uint32_t)fmax(1, fmin(A_PHOTO, MOST_PAIRS / ((double)n * n)));
    survey s = { .world = world,
                 .rig = rig,
                 .places = malloc((size_t)n * a_photo * sizeof *s.places),
                 .seen = calloc(n, sizeof *s.seen),
                 .n_seen = calloc(n, sizeof *s.n_seen),
                 .which = calloc(n, sizeof *s.which) };
    cn_status status = s.places && s.seen && s.n_seen && s.which
                           ? visit(&s, true, a_photo)
                           : cn_fail(CN_ERR_NOMEM, "out of memory for the points of %u photos", n);
    if (status == CN_OK) status = visit(&s, false, a_photo);
    if (status == CN_OK) status = gather(&s, scene);
    for (uint32_t i = 0; i < n && s.seen && s.which; i++) {
        free(s.seen[i]);
        free(s.which[i]);
    }
    free(s.places);
    free(s.seen);
    free(s.n_seen);
    free(s.which);
    return status;
}
