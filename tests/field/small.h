/* Small settings, for the tests that go over the types of field. */
#ifndef CONURB_TESTS_SMALL_FIELD_H
#define CONURB_TESTS_SMALL_FIELD_H
#include "field/field.h"

#include <stdlib.h>
#include <string.h>

/* Options of these names get these values, within their ranges; a type's other options stay as in the preview preset.
 */
static inline cn_field_options small_field(const cn_field_type *type, double finest)
{
    const struct {
        const char *name;
        double value;
    } small[] = {
        { "levels", 4 },
        { "log2_table", 10 },
        { "base_resolution", 4 },
        { "finest_resolution", finest },
        { "frequencies", 4 },
        { "direction_frequencies", 2 },
        { "depth", 3 },
        { "width", 16 },
        { "skip", 2 },
        { "colour_units", 12 },
        { "cells", 4 },
        { "log2_networks", 6 },
        { "cell_frequencies", 2 },
        { "log2_points", 12 },
        { "base_cells", 4 },
        { "finest_cells", 10 },
        { "density_width", 16 },
        { "colour_width", 12 },
    };
    cn_field_options field;
    if (cn_field_options_preset(type->name, CN_QUALITY_PREVIEW, &field) != CN_OK) abort();
    for (uint32_t i = 0; i < type->n_options; i++)
        for (size_t s = 0; s < sizeof small / sizeof *small; s++)
            if (strcmp(type->options[i].name, small[s].name) == 0)
                field.value[i] = fmin(type->options[i].most, fmax(type->options[i].least, small[s].value));
    return field;
}

/* Another value of an option, near this one. Whole numbers change by 4, because widths of networks are multiples of 4.
 */
static inline double other_value(const cn_field_option *option, double value)
{
    if (!option->whole) return value > option->least ? 0.5 * (option->least + value) : option->most;
    if (option->most - option->least < 8) return value < option->most ? value + 1 : value - 1;
    return value + 4 <= option->most ? value + 4 : value - 4;
}
#endif
