#include "field/field.h"

#include "base/contraction.h"

#include <string.h>

double cn_field_option_of(const cn_field *field, const char *name)
{
    for (uint32_t i = 0; i < field->type->n_options; i++)
        if (strcmp(field->type->options[i].name, name) == 0) return field->options.value[i];
    return NAN;
}

void cn_field_add_block(cn_field *field, const char *name, cn_field_storage storage, uint64_t rows, uint64_t columns,
                        size_t offset)
{
    field->block[field->n_blocks++] = (cn_field_block){ name, storage, { rows, columns }, offset };
}

void cn_field_uncontract_gradient(const float x[3], const float d_pos[3], float d_x[3])
{
    int k = 0;
    for (int a = 1; a < 3; a++)
        if (fabsf(x[a]) > fabsf(x[k])) k = a;
    const float m = fabsf(x[k]), scale = cn_contraction_float(m);
    float across = 0;
    for (int a = 0; a < 3; a++) {
        d_x[a] = 0.25f * scale * d_pos[a];
        across += 0.25f * x[a] * d_pos[a];
    }
    /* y = x s(m), s = 2/m - 1/m^2 */
    if (m > 1) d_x[k] += (x[k] < 0 ? -1.0f : 1.0f) * across * (2 / (m * m * m) - 2 / (m * m));
}
