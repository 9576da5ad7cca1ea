/* How the encoding changes with position: for effects that move rays. Plain C: it runs only where such an effect is on,
 * and then only for live samples. */
#include "field/field.h"

#include <math.h>

/* Adds the slope of one level at one position, weighed by the gradients of its two features. */
static void add_level(const cn_level *level, const uint32_t *table, const float pos[3], float g0, float g1,
                      float slope[3])
{
    float f[3];
    uint32_t c[3];
    for (int a = 0; a < 3; a++) {
        const float x = fminf(fmaxf(pos[a], 0), 1) * (float)level->resolution + 0.5f, cell = floorf(x);
        f[a] = x - cell;
        c[a] = (uint32_t)cell;
    }
    for (uint32_t i = 0; i < 8; i++) {
        const uint32_t pair = table[cn_level_entry(level, c[0] + (i & 1), c[1] + ((i >> 1) & 1), c[2] + (i >> 2))];
        const float value = (g0 * cn_bf16_to_float((uint16_t)pair) + g1 * cn_bf16_to_float((uint16_t)(pair >> 16))) *
                            (float)level->resolution;
        const float w[3] = { (i & 1) ? f[0] : 1 - f[0], (i & 2) ? f[1] : 1 - f[1], (i & 4) ? f[2] : 1 - f[2] };
        slope[0] += ((i & 1) ? value : -value) * w[1] * w[2];
        slope[1] += ((i & 2) ? value : -value) * w[0] * w[2];
        slope[2] += ((i & 4) ? value : -value) * w[0] * w[1];
    }
}

void cn_field_slope(const cn_field *field, const uint32_t *table, const float *pos, const float *d_enc, uint32_t n,
                    float (*d_pos)[3])
{
    for (uint32_t i = 0; i < n; i++) {
        const size_t panel = i / CN_PANEL, lane = i % CN_PANEL;
        const float *p = pos + panel * 3 * CN_PANEL + lane, *d = d_enc + panel * field->enc_rows * CN_PANEL + lane;
        const float x[3] = { p[0], p[CN_PANEL], p[2 * CN_PANEL] };
        d_pos[i][0] = d_pos[i][1] = d_pos[i][2] = 0;
        for (uint32_t l = 0; l < field->config.levels; l++)
            add_level(&field->level[l], table + field->level[l].offset, x, d[(size_t)2 * l * CN_PANEL],
                      d[((size_t)2 * l + 1) * CN_PANEL], d_pos[i]);
    }
}

void cn_field_uncontract_slope(const float x[3], const float d_pos[3], float d_x[3])
{
    int k = 0;
    for (int a = 1; a < 3; a++)
        if (fabsf(x[a]) > fabsf(x[k])) k = a;
    const float m = fabsf(x[k]), scale = m > 1 ? (2 - 1 / m) / m : 1;
    float across = 0;
    for (int a = 0; a < 3; a++) {
        d_x[a] = 0.25f * scale * d_pos[a];
        across += 0.25f * x[a] * d_pos[a];
    }
    /* y = x s(m), s = 2/m - 1/m^2 */
    if (m > 1) d_x[k] += (x[k] < 0 ? -1.0f : 1.0f) * across * (2 / (m * m * m) - 2 / (m * m));
}
