/* A surface is matched from one side only: SIFT finds little again beyond 50 degrees. A photo that sees most of its
 * points more than 60 degrees from the nearest of the other photos has a wrong pose, however small its errors. One took
 * the reflection of a hill in a window for the hill, and stood 260 units behind it, 99 degrees from the others; the
 * other photos of that walk were within 20 units. The median over a photo's points was at most 33 degrees for 407 right
 * photos of 17 sets, and 86 and 99 for two wrong ones (experiments.md, "Photos behind what they show"). */
#include "pose/opposite.h"

#include "math/linalg.h"
#include "pose/scene.h"

#include <stdlib.h>

#define BEHIND 0.5 /* cosine of 60 degrees */
enum {
    ONE_IN = 10,
    MOST_RAYS = 64, /* others that an observation is compared with: enough to hold a near one */
    NAMED_AT_MOST = 10
};

typedef struct counts {
    uint32_t n, behind;
} counts;

/* The cosine between the rays from a point to observation i's view and to the nearest other view. */
static double nearest_cosine(const double (*rays)[3], const cn_observation *seen, uint32_t n, uint32_t i)
{
    const uint32_t others = n - 1, compared = others < MOST_RAYS ? others : MOST_RAYS;
    double best = -1;
    for (uint32_t k = 0; k < compared; k++) {
        const uint32_t j = (i + 1 + (uint32_t)((uint64_t)k * others / compared)) % n;
        const double cosine = cn_dot3(rays[i], rays[j]);
        if (seen[j].view != seen[i].view && cosine > best) best = cosine;
    }
    return best;
}

static cn_status count(const cn_scene *scene, counts *of)
{
    double(*rays)[3] = NULL;
    size_t room = 0;
    for (uint32_t p = 0; p < scene->n_points; p++) {
        const cn_point *point = &scene->points[p];
        const cn_observation *seen = scene->observations + point->first_observation;
        const uint32_t n = point->n_observations;
        if (n < 2) continue;
        if (n > room) {
            free(rays);
            room = 2 * (size_t)n;
            rays = malloc(room * sizeof *rays);
            if (!rays) return cn_fail(CN_ERR_NOMEM, "out of memory looking for photos with a wrong pose");
        }
        for (uint32_t i = 0; i < n; i++) {
            cn_view_centre(&scene->views[seen[i].view], rays[i]);
            for (int k = 0; k < 3; k++)
                rays[i][k] -= point->xyz[k];
            cn_normalize3(rays[i]);
        }
        for (uint32_t i = 0; i < n; i++) {
            of[seen[i].view].n++;
            of[seen[i].view].behind += nearest_cosine((const double(*)[3])rays, seen, n, i) < BEHIND;
        }
    }
    free(rays);
    return CN_OK;
}

/* Gives all observations of points that fewer than two of the kept views see to a view that is left out, so that they
 * go with it. */
static void give_up_points(cn_scene *scene, const bool *keep)
{
    for (uint32_t p = 0; p < scene->n_points; p++) {
        cn_observation *seen = scene->observations + scene->points[p].first_observation;
        const uint32_t n = scene->points[p].n_observations;
        uint32_t kept = 0, out = UINT32_MAX;
        for (uint32_t i = 0; i < n; i++) {
            kept += keep[seen[i].view];
            if (!keep[seen[i].view]) out = seen[i].view;
        }
        for (uint32_t i = 0; i < n && kept < 2 && out != UINT32_MAX; i++)
            seen[i].view = out;
    }
}

cn_status cn_pose_drop_opposite(const cn_context *ctx, cn_scene *scene)
{
    counts *of = calloc(scene->n_views + (size_t)1, sizeof *of);
    bool *keep = malloc(scene->n_views + (size_t)1);
    cn_status status =
        of && keep ? count(scene, of) : cn_fail(CN_ERR_NOMEM, "out of memory looking for photos with a wrong pose");
    uint32_t n_out = 0;
    for (uint32_t i = 0; status == CN_OK && i < scene->n_views; i++) {
        keep[i] = 2 * of[i].behind <= of[i].n;
        n_out += !keep[i];
    }
    if (status == CN_OK && n_out && n_out <= scene->n_views / ONE_IN) {
        for (uint32_t i = 0, named = 0; i < scene->n_views; i++)
            if (!keep[i] && named++ < NAMED_AT_MOST)
                cn_log(ctx, CN_LOG_WARN,
                       "%s gets no pose: the one that was found sees %u of its %u sparse points from another side than "
                       "the other photos",
                       scene->views[i].name, of[i].behind, of[i].n);
        give_up_points(scene, keep);
        status = cn_scene_keep_views(scene, keep);
    }
    free(of);
    free(keep);
    return status;
}
