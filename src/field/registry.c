/* The list of field types. To add one: a file in this folder and a line here. */
#include "field/field.h"

#include <stdio.h>
#include <string.h>

extern const cn_field_type cn_field_type_hash;
extern const cn_field_type cn_field_type_dense;
extern const cn_field_type cn_field_type_voxels;
extern const cn_field_type cn_field_type_nerf;
extern const cn_field_type cn_field_type_sdf;
extern const cn_field_type cn_field_type_points;
extern const cn_field_type cn_field_type_kilo;

const cn_field_type *const cn_field_types[] = { &cn_field_type_hash, &cn_field_type_dense, &cn_field_type_voxels,
                                                &cn_field_type_nerf, &cn_field_type_sdf,   &cn_field_type_points,
                                                &cn_field_type_kilo };
const uint32_t cn_field_n_types = sizeof cn_field_types / sizeof *cn_field_types;

const cn_field_type *cn_field_type_find(const char *name)
{
    for (uint32_t i = 0; i < cn_field_n_types; i++)
        if (strcmp(cn_field_types[i]->name, name) == 0) return cn_field_types[i];
    return NULL;
}

cn_status cn_field_layout(cn_field *field, const cn_field_options *options, cn_field_inputs inputs)
{
    memset(field, 0, sizeof *field);
    field->type = cn_field_type_find(options->type);
    if (!field->type)
        return cn_fail(CN_ERR_CONFIG, "field.type '%.15s' is unknown; give one of the types that city.yaml lists",
                       options->type);
    field->options = *options;
    field->inputs = inputs;
    return field->type->layout(field);
}

bool cn_field_type_at(uint32_t i, const char **name, const char **summary)
{
    if (i >= cn_field_n_types) return false;
    *name = cn_field_types[i]->name;
    *summary = cn_field_types[i]->summary;
    return true;
}

const cn_field_option *cn_field_type_options(const char *type, uint32_t *n)
{
    const cn_field_type *t = cn_field_type_find(type);
    *n = t ? t->n_options : 0;
    return t ? t->options : NULL;
}

cn_status cn_field_options_preset(const char *type, cn_quality quality, cn_field_options *options)
{
    const cn_field_type *t = cn_field_type_find(type);
    char known[128] = "";
    for (uint32_t i = 0; i < cn_field_n_types; i++) {
        const size_t used = strlen(known);
        snprintf(known + used, sizeof known - used, "%s%s", i ? ", " : "", cn_field_types[i]->name);
    }
    memset(options, 0, sizeof *options);
    if (!t) return cn_fail(CN_ERR_CONFIG, "field.type '%.32s' is unknown; give one of %s", type, known);
    snprintf(options->type, sizeof options->type, "%s", t->name);
    for (uint32_t i = 0; i < t->n_options; i++)
        options->value[i] = t->options[i].preset[quality];
    return CN_OK;
}

/* Index of an option of a type, or -1. */
static int index_of(const cn_field_type *type, const char *name)
{
    for (uint32_t i = 0; type && i < type->n_options; i++)
        if (strcmp(type->options[i].name, name) == 0) return (int)i;
    return -1;
}

static cn_status no_such_option(const cn_field_options *options, const char *name)
{
    for (uint32_t i = 0; i < cn_field_n_types; i++)
        if (index_of(cn_field_types[i], name) >= 0)
            return cn_fail(CN_ERR_CONFIG, "field.%s is a setting of %s, not of %s; remove it, or set field.type to %s",
                           name, cn_field_types[i]->name, options->type, cn_field_types[i]->name);
    return cn_fail(CN_ERR_CONFIG, "no type of field has a setting '%.64s'", name);
}

cn_status cn_field_options_set(cn_field_options *options, const char *name, double value)
{
    const cn_field_type *type = cn_field_type_find(options->type);
    const int i = index_of(type, name);
    if (i < 0) return no_such_option(options, name);
    const cn_field_option *o = &type->options[i];
    if (!(value >= o->least && value <= o->most) || (o->whole && value != floor(value)))
        return cn_fail(CN_ERR_CONFIG, "field.%s is %.10g; give %s%.10g to %.10g", name, value,
                       o->whole ? "a whole number from " : "", o->least, o->most);
    options->value[i] = value;
    return CN_OK;
}

double cn_field_options_get(const cn_field_options *options, const char *name)
{
    const int i = index_of(cn_field_type_find(options->type), name);
    return i < 0 ? NAN : options->value[i];
}

void cn_field_options_print(const cn_field_options *options, char *out, size_t size)
{
    const cn_field_type *type = cn_field_type_find(options->type);
    size_t n = (size_t)snprintf(out, size, "%s", options->type);
    for (uint32_t i = 0; type && i < type->n_options && n < size; i++)
        n += (size_t)snprintf(out + n, size - n, " %s=%.9g", type->options[i].name, options->value[i]);
}

uint64_t cn_field_options_bytes(const cn_field_options *options)
{
    cn_field field;
    if (cn_field_layout(&field, options, (cn_field_inputs){ 16, 16 }) != CN_OK) return 0;
    return field.entries * 4 + (field.n_weights + field.n_derived) * sizeof(float);
}
