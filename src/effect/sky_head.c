#include "effect/sky.h"
#include "rays/rays.h"

const cn_head cn_sky_head = { CN_SKY_IN, CN_SKY_WIDTH, CN_SKY_OUT };
/* What the harmonics are multiplied by before the head, by degree: a smooth sky is learned first. */
static const float of_degree[4] = { 1, 0.5f, 0.25f, 0.125f };

void cn_sky_see(const float dir[3], const cn_head_acts *a, uint32_t i)
{
    float harmonics[CN_SKY_IN];
    cn_rays_harmonics(dir, harmonics);
    for (uint32_t k = 0; k < CN_SKY_IN; k++)
        *cn_head_at(a->in, CN_SKY_IN, k, i) = of_degree[k < 1 ? 0 : k < 4 ? 1 : k < 9 ? 2 : 3] * harmonics[k];
}
