/* Goes over every type of field in the list. What it declares is consistent. A setting that it lacks, or that is out of
 * range, gives a message of one line. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>

#include "base/file.h"
#include "city/config.h"
#include "small.h"

#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>

static void says(const char *text)
{
    const char *message = cn_error_message();
    if (!strstr(message, text) || strchr(message, '\n')) fail_msg("'%s' is not one line with '%s'", message, text);
}

static void test_list(void **state)
{
    (void)state;
    const char *name, *summary;
    for (uint32_t i = 0; i < cn_field_n_types; i++) {
        assert_true(cn_field_type_at(i, &name, &summary));
        assert_true(strlen(name) > 0 && strlen(name) < CN_FIELD_TYPE_SIZE && strlen(summary) > 0);
        assert_ptr_equal(cn_field_type_find(name), cn_field_types[i]); /* so that no two have the same name */
        assert_true(cn_field_types[i]->n_options <= CN_FIELD_OPTIONS_MAX);
    }
    assert_false(cn_field_type_at(cn_field_n_types, &name, &summary));
    assert_null(cn_field_type_find("none such"));
}

/* Every entry of the table and every weight is in exactly one block. Sections cover the table up
 * to the entries that are fixed, and begin at multiples of
 * 8 floats. */
static void blocks_of(const cn_field *f)
{
    uint8_t *in_table = calloc(f->entries + 1, 1), *in_weights = calloc(f->n_weights + 1, 1),
            *in_section = calloc(f->entries + 1, 1);
    assert_true(in_table && in_weights && in_section);
    assert_true(f->n_blocks > 0 && f->n_blocks <= CN_FIELD_BLOCKS);
    assert_int_equal(f->n_weights % 8, 0);
    for (uint32_t b = 0; b < f->n_blocks; b++) {
        const cn_field_block *block = &f->block[b];
        const bool table = block->storage == CN_FIELD_TABLE;
        const size_t n = table ? block->dims[0] : block->dims[0] * block->dims[1];
        if (table) assert_int_equal(block->dims[1], 2);
        assert_true(strlen(block->name) > 0 && strlen(block->name) < 64);
        for (uint32_t other = 0; other < b; other++)
            assert_string_not_equal(block->name, f->block[other].name);
        assert_true(block->offset + n <= (table ? f->entries : f->n_weights));
        for (size_t i = block->offset; i < block->offset + n; i++)
            assert_int_equal((table ? in_table : in_weights)[i]++, 0);
    }
    for (uint32_t s = 0; s < f->n_sections; s++) {
        assert_int_equal(f->section[s].first % 4, 0);
        for (size_t i = 0; i < f->section[s].entries; i++) {
            assert_true(f->section[s].first + i < f->entries);
            assert_int_equal(in_section[f->section[s].first + i]++, 0);
        }
    }
    for (size_t i = 0; i < f->entries; i++)
        assert_true(in_table[i] && in_section[i] == (i < f->entries - f->fixed));
    size_t in_none = 0;
    for (size_t i = 0; i < f->n_weights; i++)
        in_none += !in_weights[i];
    assert_true(in_none < 8); /* only padding */
    free(in_table);
    free(in_weights);
    free(in_section);
}

static void test_layout(void **state)
{
    (void)state;
    for (uint32_t i = 0; i < cn_field_n_types; i++)
        for (int q = 0; q < CN_QUALITIES; q++)
            for (uint32_t conditioning = 0; conditioning < 40; conditioning += 13) {
                cn_field_options options;
                cn_field f;
                assert_int_equal(cn_field_options_preset(cn_field_types[i]->name, (cn_quality)q, &options), CN_OK);
                if (q == CN_QUALITY_REFERENCE) options = small_field(cn_field_types[i], 24);
                assert_int_equal(
                    cn_field_layout(&f, &options, (cn_field_inputs){ conditioning, conditioning >= 16 ? 16 : 0 }),
                    CN_OK);
                assert_true(f.conditioning >= conditioning && f.conditioning < conditioning + 4);
                assert_int_equal(cn_field_options_bytes(&options) > 0, 1);
                blocks_of(&f);
            }
}

/* What a tile of quality compact has on disk, but for its photos' codes, is less than 1 MB. */
static void test_compact(void **state)
{
    (void)state;
    for (uint32_t i = 0; i < cn_field_n_types; i++) {
        cn_field_options options;
        cn_field f;
        assert_int_equal(cn_field_options_preset(cn_field_types[i]->name, CN_QUALITY_COMPACT, &options), CN_OK);
        assert_int_equal(cn_field_layout(&f, &options, (cn_field_inputs){ 76, 16 }), CN_OK);
        const size_t bytes = f.entries * sizeof(uint32_t) + f.n_weights * sizeof(float) + CN_OCC_CELLS / 8;
        if (bytes > 950000) fail_msg("%s takes %zu bytes", f.type->name, bytes);
        assert_true(bytes > 500000);
    }
}

static void test_first_values(void **state)
{
    (void)state;
    for (uint32_t t = 0; t < cn_field_n_types; t++) {
        const cn_field_options options = small_field(cn_field_types[t], 24);
        cn_field f;
        assert_int_equal(cn_field_layout(&f, &options, (cn_field_inputs){ 19, 16 }), CN_OK);
        const size_t n = 2 * f.entries + f.n_weights;
        float *values[3]; /* seeds 1, 1 and 2 */
        for (int i = 0; i < 3; i++) {
            values[i] = calloc(n, sizeof **values);
            assert_non_null(values[i]);
            f.type->init(&f, i < 2 ? 1 : 2, values[i], values[i] + 2 * f.entries);
        }
        for (size_t i = 0; i < n; i++)
            assert_true(isfinite(values[0][i]));
        assert_memory_equal(values[0], values[1], n * sizeof **values);
        assert_memory_not_equal(values[0], values[2], n * sizeof **values);
        for (int i = 0; i < 3; i++)
            free(values[i]);
    }
}

/* Keys of stages, checkpoints and measured speeds are made from this text. Another setting has to change it. */
static void test_every_setting_is_in_the_text(void **state)
{
    (void)state;
    for (uint32_t t = 0; t < cn_field_n_types; t++) {
        const cn_field_type *type = cn_field_types[t];
        cn_field_options options;
        char before[256], after[256];
        assert_int_equal(cn_field_options_preset(type->name, CN_QUALITY_STANDARD, &options), CN_OK);
        cn_field_options_print(&options, before, sizeof before);
        assert_int_equal(strncmp(before, type->name, strlen(type->name)), 0);
        assert_true(strlen(before) < sizeof before - 1);
        for (uint32_t i = 0; i < type->n_options; i++) {
            cn_field_options other = options;
            const double value =
                options.value[i] == type->options[i].least ? type->options[i].most : type->options[i].least;
            assert_int_equal(cn_field_options_set(&other, type->options[i].name, value), CN_OK);
            assert_true(cn_field_options_get(&other, type->options[i].name) == value);
            cn_field_options_print(&other, after, sizeof after);
            assert_string_not_equal(before, after);
        }
    }
}

static void refuses(const cn_field_options *options, const char *name, double value, const char *text)
{
    cn_field_options other = *options;
    assert_int_equal(cn_field_options_set(&other, name, value), CN_ERR_CONFIG);
    says(text);
    assert_memory_equal(&other, options, sizeof other);
}

static void test_bad_options(void **state)
{
    (void)state;
    cn_field_options options;
    assert_int_equal(cn_field_options_preset("none such", CN_QUALITY_HIGH, &options), CN_ERR_CONFIG);
    says("'none such'");
    for (uint32_t t = 0; t < cn_field_n_types; t++)
        says(cn_field_types[t]->name);
    for (uint32_t t = 0; t < cn_field_n_types; t++) {
        const cn_field_type *type = cn_field_types[t];
        assert_int_equal(cn_field_options_preset(type->name, CN_QUALITY_STANDARD, &options), CN_OK);
        for (uint32_t i = 0; i < type->n_options; i++) {
            const cn_field_option *o = &type->options[i];
            const double bad[] = { o->least - 1, o->most + 1, NAN, INFINITY, -INFINITY };
            for (size_t b = 0; b < sizeof bad / sizeof *bad; b++)
                refuses(&options, o->name, bad[b], o->name);
            if (o->whole) refuses(&options, o->name, o->least + 0.5, "whole number");
            for (int q = 0; q < CN_QUALITIES; q++)
                assert_true(o->preset[q] >= o->least && o->preset[q] <= o->most);
        }
        refuses(&options, "zzz", 1, "'zzz'");
        assert_true(isnan(cn_field_options_get(&options, "zzz")));
    }
}

/* A setting that only another type has: the message names that type. */
static void test_options_of_another_type(void **state)
{
    (void)state;
    for (uint32_t a = 0; a < cn_field_n_types; a++)
        for (uint32_t b = 0; b < cn_field_n_types; b++) {
            cn_field_options options;
            assert_int_equal(cn_field_options_preset(cn_field_types[a]->name, CN_QUALITY_HIGH, &options), CN_OK);
            for (uint32_t i = 0; i < cn_field_types[b]->n_options; i++) {
                const cn_field_option *o = &cn_field_types[b]->options[i];
                if (!isnan(cn_field_options_get(&options, o->name))) continue;
                refuses(&options, o->name, o->least, o->name);
                says(cn_field_types[a]->name);
            }
        }
}

static char folder[] = "/tmp/conurb-field-XXXXXX";

static int make_folder(void **state)
{
    (void)state;
    return mkdtemp(folder) ? 0 : -1;
}

static int remove_folder(void **state)
{
    char path[64];
    (void)state;
    snprintf(path, sizeof path, "%s/city.yaml", folder);
    unlink(path);
    return rmdir(folder);
}

static cn_status load(cn_config *config, const char *type, const char *name, double value)
{
    char path[64], text[256];
    snprintf(path, sizeof path, "%s/city.yaml", folder);
    snprintf(text, sizeof text, "version: 1\nphotos:\n  folder: here\nfield:\n  type: %s\n  %s: %.9g\n", type, name,
             value);
    assert_int_equal(cn_file_write(path, text, strlen(text)), CN_OK);
    return cn_config_load(config, folder);
}

static void test_city_yaml(void **state)
{
    (void)state;
    cn_config config;
    for (uint32_t t = 0; t < cn_field_n_types; t++) {
        const cn_field_type *type = cn_field_types[t];
        for (uint32_t i = 0; i < type->n_options; i++) {
            const cn_field_option *o = &type->options[i];
            const double value = other_value(o, o->preset[CN_QUALITY_STANDARD]);
            if (load(&config, type->name, o->name, value) != CN_OK) fail_msg("%s", cn_error_message());
            assert_string_equal(config.train.field.type, type->name);
            assert_true(cn_field_options_get(&config.train.field, o->name) == value);
            for (uint32_t other = 0; other < type->n_options; other++)
                if (other != i)
                    assert_true(config.train.field.value[other] == type->options[other].preset[config.quality]);
            cn_config_deinit(&config);
            assert_int_equal(load(&config, type->name, o->name, o->most + 1), CN_ERR_CONFIG);
            says(o->name);
            says("city.yaml:6");
        }
        assert_int_equal(load(&config, type->name, "zzz", 1), CN_ERR_CONFIG);
        says("zzz");
    }
    assert_int_equal(load(&config, "nonesuch", "levels", 4), CN_ERR_CONFIG);
    says("nonesuch");
    says("city.yaml:5");
}

/* Settings that are in range each, but do not work together; and settings that a range cannot check. */
static void test_settings_that_make_no_field(void **state)
{
    (void)state;
    cn_config config;
    for (uint32_t t = 0; t < cn_field_n_types; t++) {
        const cn_field_type *type = cn_field_types[t];
        for (uint32_t i = 0; i < type->n_options; i++)
            for (int end = 0; end < 2; end++) {
                const cn_field_option *o = &type->options[i];
                cn_field_options options;
                cn_field f;
                assert_int_equal(cn_field_options_preset(type->name, CN_QUALITY_STANDARD, &options), CN_OK);
                options.value[i] = end ? o->most : o->least;
                const cn_status expected = cn_field_layout(&f, &options, (cn_field_inputs){ 0 });
                assert_int_equal(load(&config, type->name, o->name, options.value[i]), expected);
                if (expected == CN_OK) {
                    cn_config_deinit(&config);
                } else {
                    says("city.yaml:5");
                    says(o->name);
                }
            }
    }
    assert_int_equal(load(&config, "hash", "density_width", 6), CN_ERR_CONFIG);
    says("city.yaml:5");
    says("field.density_width is 6");
}

/* Each setting has its row in tiles/README.md. */
static void test_readme(void **state)
{
    (void)state;
    char *text, row[512];
    size_t size;
    assert_int_equal(cn_file_read(CONURB_SOURCE "/tiles/README.md", 0, &text, &size), CN_OK);
    for (uint32_t t = 0; t < cn_field_n_types; t++)
        for (uint32_t i = 0; i < cn_field_types[t]->n_options; i++) {
            const cn_field_option *o = &cn_field_types[t]->options[i];
            snprintf(row, sizeof row, "| %s | `%s` | %s | %.10g to %.10g | %.10g |\n", cn_field_types[t]->name, o->name,
                     o->comment, o->least, o->most, o->preset[CN_QUALITY_STANDARD]);
            if (!strstr(text, row)) fail_msg("tiles/README.md lacks this row of the settings of fields: %s", row);
        }
    free(text);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_list),
        cmocka_unit_test(test_layout),
        cmocka_unit_test(test_compact),
        cmocka_unit_test(test_first_values),
        cmocka_unit_test(test_every_setting_is_in_the_text),
        cmocka_unit_test(test_bad_options),
        cmocka_unit_test(test_options_of_another_type),
        cmocka_unit_test(test_city_yaml),
        cmocka_unit_test(test_settings_that_make_no_field),
        cmocka_unit_test(test_readme),
    };
    return cmocka_run_group_tests(tests, make_folder, remove_folder);
}
