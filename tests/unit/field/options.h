/* Settings of fields for tests. */
#ifndef CONURB_TESTS_FIELD_OPTIONS_H
#define CONURB_TESTS_FIELD_OPTIONS_H
#include "conurb/field.h"

#include <stdlib.h>

/* Sets an option that the type has, whatever the range of its values is. */
static inline void field_set(cn_field_options *field, const char *name, double value)
{
    uint32_t n, found = 0;
    const cn_field_option *options = cn_field_type_options(field->type, &n);
    for (uint32_t i = 0; i < n; i++)
        for (const char *a = options[i].name, *b = name; *a == *b; a++, b++)
            if (!*a) {
                field->value[i] = value;
                found = 1;
                break;
            }
    if (!found) abort();
}

typedef struct hash_sizes {
    double levels, log2_table, base_resolution, finest_resolution, density_width, colour_width;
} hash_sizes;

static inline cn_field_options hash_options(hash_sizes s)
{
    cn_field_options field;
    if (cn_field_options_preset("hash", CN_QUALITY_STANDARD, &field) != CN_OK) abort();
    field_set(&field, "levels", s.levels);
    field_set(&field, "log2_table", s.log2_table);
    field_set(&field, "base_resolution", s.base_resolution);
    field_set(&field, "finest_resolution", s.finest_resolution);
    field_set(&field, "density_width", s.density_width);
    field_set(&field, "colour_width", s.colour_width);
    return field;
}
#endif
