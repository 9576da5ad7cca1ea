#include "splat/clear.h"

#include "math/linalg.h"

#include <math.h>
#include <stdlib.h>

void cn_clear_space_deinit(cn_clear_space *space)
{
    cn_keys_deinit(&space->cubes);
    free(space->eyes);
    free(space->next);
    *space = (cn_clear_space){ 0 };
}

static void cube_of(const cn_clear_space *space, const double xyz[3], int64_t cube[3])
{
    for (int k = 0; k < 3; k++)
        cube[k] = (int64_t)floor(xyz[k] / space->near_m);
}

cn_status cn_clear_space_init(cn_clear_space *space, const cn_scene *scene, double near_m)
{
    *space = (cn_clear_space){ .scene = scene, .near_m = near_m };
    if (!(near_m > 0)) return CN_OK;
    const size_t n = scene->n_views;
    space->eyes = malloc((n + 1) * sizeof *space->eyes);
    space->next = malloc((n + 1) * sizeof *space->next);
    cn_status status = space->eyes && space->next ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory for %zu photos", n);
    for (uint32_t v = 0; v < n && status == CN_OK; v++) {
        int64_t cube[3];
        bool fresh;
        cn_view_centre(&scene->views[v], space->eyes[v]);
        cube_of(space, space->eyes[v], cube);
        space->next[v] = UINT32_MAX;
        status = cn_keys_add(&space->cubes, cn_keys_of_cube(0, cube), v, &fresh);
        if (status != CN_OK || fresh) continue;
        /* Behind the first of its cube. */
        uint32_t *after = &space->next[cn_keys_find(&space->cubes, cn_keys_of_cube(0, cube))];
        space->next[v] = *after;
        *after = v;
    }
    if (status != CN_OK) cn_clear_space_deinit(space);
    return status;
}

/* Whether the photo shows some of what lies here, metres from its eye, and reaches reach_m about it. That is tried at
 * the place nearest to the photo's axis. */
static bool shows(const cn_scene *scene, uint32_t view, const double away[3], double reach_m)
{
    const cn_view *v = &scene->views[view];
    const cn_camera *camera = &scene->cameras[v->camera];
    double at[3], px[2];
    cn_mat3_vec(v->rotation, away, at);
    const double off = hypot(at[0], at[1]), left = off > reach_m ? 1 - reach_m / off : 0;
    if (cn_dot3(at, at) < reach_m * reach_m) return true; /* the eye is in it */
    at[0] *= left;
    at[1] *= left;
    return cn_camera_project(camera, at, px) && px[0] >= 0 && px[1] >= 0 && px[0] <= camera->width &&
           px[1] <= camera->height;
}

bool cn_clear_space_holds(const cn_clear_space *space, const double xyz[3], double reach_m)
{
    int64_t middle[3];
    if (!space->eyes) return false;
    cube_of(space, xyz, middle);
    for (int i = 0; i < 27; i++) {
        const int64_t cube[3] = { middle[0] + i % 3 - 1, middle[1] + i / 3 % 3 - 1, middle[2] + i / 9 - 1 };
        uint32_t v = cn_keys_find(&space->cubes, cn_keys_of_cube(0, cube));
        for (; v != UINT32_MAX; v = space->next[v]) {
            double away[3];
            for (int k = 0; k < 3; k++)
                away[k] = xyz[k] - space->eyes[v][k];
            if (cn_dot3(away, away) < space->near_m * space->near_m && shows(space->scene, v, away, reach_m))
                return true;
        }
    }
    return false;
}
