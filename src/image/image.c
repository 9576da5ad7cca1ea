#include "image/image.h"

#include <math.h>
#include <string.h>

/* Output cell o of n over an axis of `size` input cells: [from, to), with fractional ends. */
typedef struct cover {
    uint32_t first, last;
    double from, to;
} cover;
static cover cover_of(uint32_t o, uint32_t n, uint32_t size)
{
    cover c = { .from = (double)o * size / n, .to = (double)(o + 1) * size / n };
    c.first = (uint32_t)c.from;
    c.last = (uint32_t)ceil(c.to);
    if (c.last > size) c.last = size;
    return c;
}
static double share(const cover *c, uint32_t i)
{
    return fmin(c->to, i + 1.0) - fmax(c->from, (double)i);
}

void cn_image_shrink(const float *in, uint32_t w, uint32_t h, float *out, uint32_t out_w, uint32_t out_h)
{
    for (uint32_t v = 0; v < out_h; v++) {
        const cover cy = cover_of(v, out_h, h);
        for (uint32_t u = 0; u < out_w; u++) {
            const cover cx = cover_of(u, out_w, w);
            double sum[3] = { 0 }, weight = 0, area = 0;
            for (uint32_t y = cy.first; y < cy.last; y++) {
                const double sy = share(&cy, y);
                for (uint32_t x = cx.first; x < cx.last; x++) {
                    const float *p = in + 4 * ((size_t)y * w + x);
                    const double a = sy * share(&cx, x);
                    area += a;
                    if (!isfinite(p[0] + p[1] + p[2] + p[3]) || !(p[3] > 0)) continue;
                    for (int c = 0; c < 3; c++)
                        sum[c] += a * (double)p[3] * (double)p[c];
                    weight += a * (double)p[3];
                }
            }
            float *q = out + 4 * ((size_t)v * out_w + u);
            for (int c = 0; c < 3; c++)
                q[c] = weight > 0 ? (float)(sum[c] / weight) : 0;
            q[3] = (float)(weight / area);
        }
    }
}

uint16_t cn_half_from_float(float x)
{
    uint32_t bits;
    memcpy(&bits, &x, 4);
    const uint32_t sign = bits >> 16 & 0x8000u;
    bits &= 0x7fffffffu;
    if (bits > 0x7f800000u) return (uint16_t)(sign | 0x7e00u);  /* NaN */
    if (bits >= 0x477ff000u) return (uint16_t)(sign | 0x7bffu); /* past 65504 */
    if (bits < 0x38800000u) { /* subnormal: add at a fixed scale and let the adder round */
        float magnitude, magic = 0.5f;
        memcpy(&magnitude, &bits, 4);
        magnitude += magic;
        uint32_t rounded, base;
        memcpy(&rounded, &magnitude, 4);
        memcpy(&base, &magic, 4);
        return (uint16_t)(sign | (rounded - base));
    }
    bits += 0xfffu + (bits >> 13 & 1u);
    return (uint16_t)(sign | ((bits - 0x38000000u) >> 13));
}

float cn_half_to_float(uint16_t h)
{
    const uint32_t sign = (uint32_t)(h & 0x8000u) << 16, rest = h & 0x7fffu;
    uint32_t bits;
    float x;
    if (rest >= 0x7c00u) {
        bits = sign | 0x7f800000u | (rest & 0x3ffu) << 13;
    } else if (rest >= 0x400u) {
        bits = sign | ((rest << 13) + 0x38000000u);
    } else {
        x = (float)rest * 0x1p-24f;
        memcpy(&bits, &x, 4);
        bits |= sign;
    }
    memcpy(&x, &bits, 4);
    return x;
}
