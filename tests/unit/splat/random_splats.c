#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>

#include "random_splats.h"

#include "base/rng.h"

#include <math.h>
#include <string.h>

static float between(uint64_t seed, float low, float high, uint64_t stream, uint64_t at)
{
    return low + (high - low) * cn_rng_float(seed, stream, at);
}

cn_splats *random_splats(uint32_t n, uint32_t degree, const double origin[3], float reach_m, uint64_t seed)
{
    cn_splats *s;
    assert_int_equal(cn_splats_create(&s, n, degree), CN_OK);
    memcpy(s->origin, origin, sizeof s->origin);
    for (size_t i = 0; i < n; i++) {
        float norm = 0;
        for (size_t k = 0; k < 4; k++) {
            s->rotation[i][k] = between(seed, -1, 1, 1, 4 * i + k);
            norm += s->rotation[i][k] * s->rotation[i][k];
        }
        for (size_t k = 0; k < 4; k++)
            s->rotation[i][k] /= sqrtf(norm);
        for (size_t k = 0; k < 3; k++) {
            s->centre[i][k] = between(seed, -reach_m, reach_m, 2, 3 * i + k);
            s->scale[i][k] = expf(between(seed, -6, 1, 3, 3 * i + k));
        }
        s->opacity[i] = between(seed, 0.01f, 0.99f, 4, i);
        for (size_t k = 0; k < 3 * (degree + 1) * (degree + 1); k++)
            s->colour[i * 3 * (degree + 1) * (degree + 1) + k] = between(seed, -0.7f, 0.7f, 5, 64 * i + k);
    }
    return s;
}
