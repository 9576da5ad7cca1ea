#include "rays/rays.h"

#include "field/occupancy.h"
#include "math/linalg.h"

#include <math.h>

float cn_box_inv_extent(const cn_box *box)
{
    return (float)(3.0 / (box->half_extent[0] + box->half_extent[1] + box->half_extent[2]));
}

cn_box_units cn_box_units_of(const cn_box *box)
{
    const float inv_extent = cn_box_inv_extent(box);
    cn_box_units units;
    for (int a = 0; a < 3; a++) {
        const float half = (float)box->half_extent[a];
        units.to_mean[a] = half * inv_extent;
        units.from_mean[a] = 1 / units.to_mean[a];
        units.from_m[a] = 1 / half;
    }
    return units;
}

void cn_ray_generator_init(cn_ray_generator *generator, const cn_camera *camera, const cn_view *view, const cn_box *box)
{
    generator->camera = *camera;
    cn_mat3_transpose(view->rotation, generator->world_from_cam);
    double centre[3];
    cn_view_centre(view, centre);
    for (int a = 0; a < 3; a++) {
        generator->origin[a] = centre[a] - box->centre[a];
        generator->inv_extent[a] = 1 / box->half_extent[a];
    }
}

bool cn_ray_generator_ray(const cn_ray_generator *generator, double x_px, double y_px, cn_ray *ray)
{
    double in_camera[3], dir[3];
    if (cn_camera_unproject(&generator->camera, x_px, y_px, in_camera) != CN_OK) return false;
    cn_mat3_vec(generator->world_from_cam, in_camera, dir);
    for (int a = 0; a < 3; a++) {
        ray->dir[a] = (float)dir[a];
        ray->box_ray.origin[a] = (float)(generator->origin[a] * generator->inv_extent[a]);
        ray->box_ray.dir[a] = (float)(dir[a] * generator->inv_extent[a]);
    }
    return true;
}

void cn_ray_make(const cn_box *box, const double origin[3], const double dir[3], cn_ray *ray)
{
    for (int a = 0; a < 3; a++) {
        ray->dir[a] = (float)dir[a];
        ray->box_ray.origin[a] = (float)((origin[a] - box->centre[a]) / box->half_extent[a]);
        ray->box_ray.dir[a] = (float)(dir[a] / box->half_extent[a]);
    }
}

void cn_rays_harmonics(const float dir[3], float out[16])
{
    const float x = dir[0], y = dir[1], z = dir[2], xx = x * x, yy = y * y, zz = z * z;
    out[0] = 0.28209479f;
    out[1] = -0.48860251f * y;
    out[2] = 0.48860251f * z;
    out[3] = -0.48860251f * x;
    out[4] = 1.09254843f * x * y;
    out[5] = -1.09254843f * y * z;
    out[6] = 0.94617470f * zz - 0.31539157f;
    out[7] = -1.09254843f * x * z;
    out[8] = 0.54627422f * (xx - yy);
    out[9] = 0.59004359f * y * (-3 * xx + yy);
    out[10] = 2.89061144f * x * y * z;
    out[11] = 0.45704580f * y * (1 - 5 * zz);
    out[12] = 0.37317633f * z * (5 * zz - 3);
    out[13] = 0.45704580f * x * (1 - 5 * zz);
    out[14] = 1.44530572f * z * (xx - yy);
    out[15] = 0.59004359f * x * (-xx + 3 * yy);
}

typedef struct visible_task {
    const cn_box *box;
    const cn_seeing_views *views;
    uint8_t *usable;
} visible_task;

/* At most this many views are tested for a cell. Two views that see it are enough, and views that are far apart find
 * them. Not
 * measured apart. */
enum { MAX_ASKED = 512, CELLS_PER_TASK = CN_OCC_RES * CN_OCC_RES };

/* Whether a view sees a place of the box, and from how far. */
static bool sees(const cn_ray_generator *s, const cn_box *box, const float x[3], double *distance_m)
{
    double rel[3], cam[3], xy[2];
    for (int a = 0; a < 3; a++)
        rel[a] = x[a] * box->half_extent[a] - s->origin[a];
    cn_mat3_tvec(s->world_from_cam, rel, cam);
    if (!cn_camera_project(&s->camera, cam, xy)) return false;
    *distance_m = sqrt(cam[0] * cam[0] + cam[1] * cam[1] + cam[2] * cam[2]);
    const double margin_x = 0.02 * s->camera.width, margin_y = 0.02 * s->camera.height;
    return xy[0] > -margin_x && xy[1] > -margin_y && xy[0] < s->camera.width + margin_x &&
           xy[1] < s->camera.height + margin_y;
}

static bool is_usable(const visible_task *task, uint32_t cell)
{
    const cn_seeing_views *v = task->views;
    const uint32_t asked = v->n < MAX_ASKED ? v->n : MAX_ASKED, needed = v->n < 2 ? v->n : 2;
    float x[3];
    cn_occupancy_centre(cell, x);
    uint32_t seen = 0;
    for (uint32_t i = 0; i < asked && seen < needed; i++) {
        const uint64_t view = (uint64_t)i * v->n / asked;
        double distance_m;
        if (!sees(&v->generators[view], task->box, x, &distance_m)) continue;
        if (distance_m >= (double)v->alone_from_m[view]) return true;
        seen++;
    }
    return seen >= needed;
}

static void visible_slice(void *user, size_t slice, unsigned worker)
{
    (void)worker;
    const visible_task *task = user;
    for (uint32_t i = 0; i < CELLS_PER_TASK; i++) {
        const uint32_t cell = (uint32_t)(slice * CELLS_PER_TASK + i);
        task->usable[cell] = is_usable(task, cell);
    }
}

void cn_rays_visible_cells(cn_pool *pool, const cn_box *box, const cn_seeing_views *views, uint8_t *usable)
{
    visible_task task = { box, views, usable };
    cn_pool_run(pool, CN_OCC_CELLS / CELLS_PER_TASK, visible_slice, &task);
}
