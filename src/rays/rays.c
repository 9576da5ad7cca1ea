#include "rays/rays.h"

#include "base/contraction.h"
#include "math/linalg.h"

#include <math.h>

double cn_box_contract(const cn_box *box, const double point[3], float x[3])
{
    double v[3], m = 1;
    for (int a = 0; a < 3; a++) {
        v[a] = (point[a] - box->centre[a]) / box->half_extent[a];
        m = fmax(m, fabs(v[a]));
    }
    const double factor = cn_contraction(m);
    for (int a = 0; a < 3; a++)
        x[a] = (float)(0.25 * (v[a] * factor + 2));
    return factor;
}

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
