#include "train/looks.h"

#include "effect/sky_hints.h"
#include "base/units.h"
#include "math/linalg.h"

#include <math.h>

#define LOWEST -0.15 /* sine of the elevation at which a sky ends */

static cn_look look_of(const cn_sampler *s, const float dir[3])
{
    cn_look most = CN_LOOK_NONE;
    const double world[3] = { (double)dir[0], (double)dir[1], (double)dir[2] };
    for (uint32_t i = 0; i < s->n_photos && most != CN_LOOK_SKY; i++) {
        const cn_ray_generator *g = &s->photos[i].generator;
        double cam[3], at[2];
        cn_mat3_tvec(g->world_from_cam, world, cam);
        if (!cn_camera_project(&g->camera, cam, at)) continue;
        if (!(at[0] >= 0 && at[1] >= 0 && at[0] < g->camera.width && at[1] < g->camera.height)) continue;
        most = CN_LOOK_SOMETHING;
        if (!s->sky_hint) continue;
        const uint32_t x = (uint32_t)(at[0] * CN_SKY_HINT_X / g->camera.width),
                       y = (uint32_t)(at[1] * CN_SKY_HINT_Y / g->camera.height);
        if (s->sky_hint[(size_t)i * CN_SKY_HINTS + y * CN_SKY_HINT_X + x] == CN_SKY_SHOWN) most = CN_LOOK_SKY;
    }
    return most;
}

void cn_looks_find(const cn_sampler *s, float (*dir)[3], uint8_t *look)
{
    const double golden = CN_PI * (3 - sqrt(5));
    for (uint32_t i = 0; i < CN_LOOKS; i++) {
        const double z = LOWEST + (1 - LOWEST) * (i + 0.5) / CN_LOOKS, r = sqrt(1 - z * z);
        dir[i][0] = (float)(r * cos(golden * i));
        dir[i][1] = (float)(r * sin(golden * i));
        dir[i][2] = (float)z;
        look[i] = (uint8_t)look_of(s, dir[i]);
    }
}
