/* city.yaml: the template states the true defaults. A mistake gives one message with file and line. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>

#include "base/file.h"
#include "city/config.h"
#include "city/keys.h"
#include "effect/effect.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

static char folder[] = "/tmp/conurb-config-XXXXXX";
static char path[128];

static int make_folder(void **state)
{
    (void)state;
    if (!mkdtemp(folder)) return -1;
    snprintf(path, sizeof path, "%s/city.yaml", folder);
    return 0;
}

static int remove_folder(void **state)
{
    (void)state;
    unlink(path);
    return rmdir(folder);
}

static cn_status load(cn_config *config, const char *text)
{
    assert_int_equal(cn_file_write(path, text, strlen(text)), CN_OK);
    return cn_config_load(config, folder);
}

/* The message begins with the file and this line, and holds the text. */
static void refused(const char *text, cn_status expected, unsigned line, const char *message)
{
    cn_config config;
    char start[160];
    assert_int_equal(load(&config, text), expected);
    assert_null(config.photos);
    snprintf(start, sizeof start, "%s:%u: ", path, line);
    if (strncmp(cn_error_message(), start, strlen(start)) != 0 || !strstr(cn_error_message(), message))
        print_error("'%s' is not '%s... %s'\n", cn_error_message(), start, message);
    assert_memory_equal(cn_error_message(), start, strlen(start));
    assert_non_null(strstr(cn_error_message(), message));
    assert_null(strchr(cn_error_message(), '\n'));
}

#define HEAD "version: 1\nphotos:\n  folder: here\n"

static void unknown_keys(void **state)
{
    (void)state;
    refused(HEAD "plan:\n  overlp: 0.4\n", CN_ERR_CONFIG, 5, "unknown key 'overlp' in plan; did you mean 'overlap'?");
    refused(HEAD "\n# a comment\ntrian:\n  steps: 3\n", CN_ERR_CONFIG, 6, "unknown key 'trian'; did you mean 'train'?");
    refused(HEAD "plan:\n  zzzzzzzzzzz: 1\n", CN_ERR_CONFIG, 5, "known are layout, centres");
    refused(HEAD "plan: {spacing_m: 3, photos: 4}\n", CN_ERR_CONFIG, 4, "unknown key 'photos' in plan");
    refused(HEAD "effects:\n  fog: on\n", CN_ERR_CONFIG, 5, "unknown key 'fog' in effects");
}

static void wrong_types(void **state)
{
    (void)state;
    refused(HEAD "plan:\n\n  overlap: much\n", CN_ERR_CONFIG, 6, "plan.overlap is 'much'; give a number");
    refused(HEAD "plan:\n  overlap: [1, 2]\n", CN_ERR_CONFIG, 5, "plan.overlap is a list or holds keys; give a number");
    refused(HEAD "plan:\n  min_photos: -4\n", CN_ERR_CONFIG, 5, "give a whole number");
    refused(HEAD "plan:\n  min_photos: 4.5\n", CN_ERR_CONFIG, 5, "give a whole number");
    refused(HEAD "train:\n  seed: -1\n", CN_ERR_CONFIG, 5, "give a whole number");
    refused(HEAD "render:\n  fps: 24p\n", CN_ERR_CONFIG, 5, "render.fps is '24p'; give a number");
    refused(HEAD "plan:\n  layout: squares\n", CN_ERR_CONFIG, 5, "give auto, grid or centres");
    refused(HEAD "train:\n  quality: 2\n", CN_ERR_CONFIG, 5, "give preview, standard, high, reference or compact");
    refused(HEAD "render: 4\n", CN_ERR_CONFIG, 4, "put its keys below it");
    refused(HEAD "plan:\n  overlap:\n", CN_ERR_CONFIG, 5, "plan.overlap is ''");
    refused("version: 1\nphotos:\n  folder: {a: b}\n", CN_ERR_CONFIG, 3, "give a text");
}

static void values_out_of_range(void **state)
{
    (void)state;
    refused(HEAD "plan:\n  spacing_m: 4\n  overlap: 7\n", CN_ERR_CONFIG, 6, "plan.overlap is 7; give 0 to 0.95");
    refused(HEAD "plan:\n  overlap: nan\n", CN_ERR_CONFIG, 5, "plan.overlap is nan");
    refused(HEAD "plan:\n  max_tile_gb: nan\n", CN_ERR_CONFIG, 5, "plan.max_tile_gb is 'nan'; give 0 to 1000000");
    refused(HEAD "plan:\n  max_tile_gb: -1\n", CN_ERR_CONFIG, 5, "plan.max_tile_gb is '-1'; give 0 to 1000000");
    refused(HEAD "plan:\n  max_tile_gb: inf\n", CN_ERR_CONFIG, 5, "plan.max_tile_gb is");
    refused(HEAD "field:\n  levels: 99\n", CN_ERR_CONFIG, 5, "field.levels is 99; give a whole number from 1 to 24");
    refused(HEAD "field:\n  type: cloud\n", CN_ERR_CONFIG, 5, "field.type 'cloud' is unknown; give one of hash, dense");
    refused(HEAD "field:\n  type: dense\n  log2_table: 12\n", CN_ERR_CONFIG, 6, "is a setting of hash, not of dense");
    refused(HEAD "field:\n  levels: [1]\n", CN_ERR_CONFIG, 5, "give a number");
    refused(HEAD "train:\n  samples_per_step: 1\n", CN_ERR_CONFIG, 5, "give 4096 to 4194304");
    refused(HEAD "compose:\n  max_tiles: 0\n", CN_ERR_CONFIG, 5, "give 1 to 16");
    refused(HEAD "  normal: here/normal\n", CN_ERR_CONFIG, 4, "photos.normal lies inside photos.folder");
    refused(HEAD "  normal_axes: blender\n", CN_ERR_CONFIG, 4, "opengl");
    refused(HEAD "plan:\n  hold_out_every: 1\n", CN_ERR_CONFIG, 5, "leaves no photo to train on");
    refused(HEAD "plan:\n  layout: centres\n", CN_ERR_CONFIG, 5, "plan.centres names no GeoJSON");
    refused("version: 1\nphotos:\n  width_px: 800\n", CN_ERR_CONFIG, 2, "photos.folder is missing");
}

static void not_a_city_file(void **state)
{
    (void)state;
    refused("", CN_ERR_CONFIG, 1, "version is missing");
    refused("- 1\n- 2\n", CN_ERR_CONFIG, 1, "version is missing");
    refused("version: 1\n", CN_ERR_CONFIG, 1, "photos.folder is missing");
    refused("version: one\n", CN_ERR_CONFIG, 1, "version is 'one'");
    refused("version: 0\n", CN_ERR_CONFIG, 1, "version is 0");
    refused(HEAD "plan: [\n", CN_ERR_CONFIG, 5, "not YAML");
    refused(HEAD "version: 1\n", CN_ERR_CONFIG, 4, "version is given twice");
    refused(HEAD "plan:\n  overlap: 0.5\n  overlap: 0.6\n", CN_ERR_CONFIG, 6, "plan.overlap is given twice");
    refused("version: 1\n\"\\xFF\": [*nobody]\n", CN_ERR_CONFIG, 2, "");
    cn_config config;
    assert_int_equal(unlink(path), 0);
    assert_int_equal(cn_config_load(&config, folder), CN_ERR_USAGE);
    assert_non_null(strstr(cn_error_message(), "is not a city"));
}

/* A newer file may hold unknown keys. The message must still say that the file is newer. */
static void a_newer_version(void **state)
{
    (void)state;
    refused("photos:\n  folder: x\n  lidar: y\nversion: 2\n", CN_ERR_VERSION, 4, "made by a newer Conurb");
}

static void paths(void **state)
{
    (void)state;
    cn_config c;
    char expected[160];
    assert_int_equal(load(&c, "version: 1\nphotos: {folder: ../p}\nposes: {import: /m, colmap: bin/colmap}\n"
                              "plan: {layout: centres, centres: c.geojson}\n"),
                     CN_OK);
    snprintf(expected, sizeof expected, "%s/../p", folder);
    assert_string_equal(c.photos, expected);
    assert_string_equal(c.poses.import, "/m");
    snprintf(expected, sizeof expected, "%s/bin/colmap", folder);
    assert_string_equal(c.poses.colmap, expected);
    snprintf(expected, sizeof expected, "%s/c.geojson", folder);
    assert_string_equal(c.plan.centres, expected);
    cn_config_deinit(&c);
}

static void every_key_is_taken(void **state)
{
    (void)state;
    cn_config c;
    assert_int_equal(
        load(&c, HEAD
             "  width_px: 100\n"
             "poses: {matcher: sequential, match_with: colmap, neighbours: 3, max_image_px: 900, refine_focal: off,\n"
             "        max_error_m: 2.5}\n"
             "plan: {layout: grid, spacing_m: 12, overlap: 0.25, min_photos: 2, hold_out_every: 5}\n"
             "effects: {sky: off, exposure: on}\n"
             "train: {quality: preview, seed: 9, steps: 10, time_budget_s: 60, checkpoint_every_s: 5,\n"
             "        samples_per_step: 5000, march_step: 0.01, learning_rate: 0.5, leave_out_occluders: off, "
             "precision: float}\n"
             "field: {levels: 4, log2_table: 10, finest_resolution: 64}\n"
             "compose: {exponent: 2, reach: 1.5, max_tiles: 2}\n"
             "render: {width_px: 320, frames: 7, fps: 30, view: ACES, look: warm, exposure_ev: -1}\n"),
        CN_OK);
    assert_int_equal(c.width_px, 100);
    assert_true(c.poses.matcher == CN_MATCH_SEQUENTIAL && c.poses.neighbours == 3 && c.poses.max_image_px == 900);
    assert_true(c.poses.match_with == CN_MATCH_WITH_COLMAP &&
                cn_config_default().poses.match_with == CN_MATCH_WITH_CONURB);
    assert_true(c.poses.refine_focal == CN_OFF && c.poses.max_error_m == 2.5);
    assert_true(c.plan.layout == CN_LAYOUT_GRID && c.plan.spacing_m == 12 && c.plan.overlap == 0.25);
    assert_true(c.plan.min_photos == 2 && c.plan.hold_out_every == 5);
    for (uint32_t i = 0; i < cn_effect_count; i++) {
        const char *name = cn_effect_list[i]->name;
        const cn_tristate wanted = strcmp(name, "sky") == 0 ? CN_OFF : strcmp(name, "exposure") == 0 ? CN_ON : CN_AUTO;
        assert_int_equal(c.effects[i], wanted);
    }
    assert_true(c.quality == CN_QUALITY_PREVIEW && c.train.seed == 9 && c.train.steps == 10 &&
                c.train.time_budget_s == 60);
    assert_true(c.train.checkpoint_every_s == 5 && cn_field_options_get(&c.train.field, "log2_table") == 10);
    assert_true(cn_field_options_get(&c.train.field, "finest_resolution") == 64 && c.train.samples_per_step == 5000 &&
                c.train.learning_rate == 0.5);
    assert_true(c.train.march_step == 0.01 && !c.train.leave_out_occluders &&
                cn_config_default().train.leave_out_occluders);
    assert_int_equal(c.train.precision, CN_PRECISION_FLOAT);
    assert_true(c.compose.exponent == 2 && c.compose.reach == 1.5 && c.compose.max_tiles == 2);
    assert_true(c.render_width_px == 320 && c.render_frames == 7 && c.render_fps == 30 && c.exposure_ev == -1);
    assert_string_equal(c.view, "ACES");
    assert_string_equal(c.look, "warm");
    cn_config_deinit(&c);
}

/* Removes the comment sign of every commented key but those that have no default. */
static char *uncommented(const char *text)
{
    char *out = strdup(text);
    assert_non_null(out);
    for (char *p = out; (p = strstr(p, "\n  # ")); p += 4)
        if (strncmp(p + 5, "import", 6) != 0 && strncmp(p + 5, "centres:", 8) != 0 &&
            strncmp(p + 5, "teacher:", 8) != 0)
            memcpy(p + 1, "    ", 4);
    /* Two spaces of indent, not four. */
    char *write = out;
    for (const char *read = out; *read; read++) {
        *write++ = *read;
        if (*read == '\n' && strncmp(read + 1, "    ", 4) == 0) read += 2;
    }
    *write = 0;
    return out;
}

static void template_shows_the_defaults(void **state)
{
    (void)state;
    cn_config a, b;
    char *text = cn_config_template("/photos", NULL, 800), *all = text ? uncommented(text) : NULL;
    assert_non_null(all);
    assert_int_equal(load(&a, text), CN_OK);
    assert_int_equal(load(&b, all), CN_OK);
    free(text);
    free(all);
    assert_string_equal(a.photos, "/photos");
    assert_null(a.import);
    assert_string_equal(a.poses.colmap, b.poses.colmap);
    assert_true(!a.view || strcmp(a.view, b.view) == 0);
    assert_true(a.train.choose && !b.train.choose); /* whose settings are named gets these */
    cn_key key;
    for (uint32_t i = 0; cn_key_at(i, &key); i++) {
        char of_a[300], of_b[300];
        cn_key_print(&key, &a, of_a, sizeof of_a);
        cn_key_print(&key, &b, of_b, sizeof of_b);
        /* A key without a default shows a sample value. */
        if (!key.sample) assert_string_equal(of_a, of_b);
    }
    cn_config_deinit(&a);
    cn_config_deinit(&b);
}

/* A budget of time chooses the settings where neither city.yaml nor the command line names any. */
static void a_budget_chooses(void **state)
{
    (void)state;
    const struct {
        const char *train;
        int quality;
        double budget_s;
        bool choose;
    } cases[] = {
        { "train: {seed: 3}\n", -1, 0, false },
        { "train: {seed: 3, steps: 9}\n", -1, 60, true },
        { "", -1, 60, true },
        { "train: {time_budget_s: 60}\n", -1, 0, true },
        { "train: {time_budget_s: 60}\n", 2, 0, false },
        { "train: {quality: high}\n", -1, 60, false },
        { "field: {log2_table: 12}\n", -1, 60, false },
        { "train: {samples_per_step: 8192}\n", -1, 60, false },
        { "train: {march_step: 0.01}\n", -1, 60, false },
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        char text[160];
        cn_config c;
        snprintf(text, sizeof text, "%s%s", HEAD, cases[i].train);
        assert_int_equal(load(&c, text), CN_OK);
        assert_int_equal(cn_config_train(&c, cases[i].quality, cases[i].budget_s).choose, cases[i].choose);
        cn_config_deinit(&c);
    }
}

/* Another quality on the command line changes what city.yaml leaves open, and nothing else. */
static void own_settings_hold_at_every_quality(void **state)
{
    (void)state;
    cn_config c;
    cn_field_options field;
    assert_int_equal(load(&c, HEAD "field: {levels: 5}\ntrain: {quality: standard, steps: 77, seed: 3}\n"), CN_OK);
    const cn_train_options high = cn_config_train(&c, CN_QUALITY_HIGH, 0);
    const cn_train_options preset = cn_train_options_preset(CN_QUALITY_HIGH);
    assert_int_equal(cn_field_options_preset("hash", CN_QUALITY_HIGH, &field), CN_OK);
    assert_true(high.steps == 77 && high.seed == 3);
    /* Who says how many steps gets them, however few the photos are. */
    assert_true(preset.steps_per_photo > 0 && high.steps_per_photo == 0);
    assert_true(cn_field_options_get(&high.field, "levels") == 5);
    assert_true(cn_field_options_get(&high.field, "log2_table") == cn_field_options_get(&field, "log2_table"));
    assert_int_equal(high.samples_per_step, preset.samples_per_step);
    cn_config_deinit(&c);
}

static void template_takes_any_name(void **state)
{
    (void)state;
    cn_config c;
    const char *name = "/a \"b\" \\c: #d\t'e' %s \xc3\xa9";
    char *text = cn_config_template(name, name, 270);
    assert_non_null(text);
    assert_int_equal(load(&c, text), CN_OK);
    free(text);
    assert_string_equal(c.photos, name);
    assert_string_equal(c.import, name);
    assert_int_equal(c.width_px, 270);
    cn_config_deinit(&c);
}

/* Every key has a place in the table, a range that holds its default, and a comment that says what it does. */
static void the_table_is_whole(void **state)
{
    (void)state;
    const cn_config defaults = cn_config_default();
    cn_key key, found;
    uint32_t n = 0;
    for (; cn_key_at(n, &key); n++) {
        double value;
        assert_true(cn_key_find(key.section, key.name, &found));
        assert_int_equal(found.offset, key.offset);
        char comment[160];
        cn_key_comment(&key, comment, sizeof comment);
        assert_true(cn_key_in_range(&key, &defaults, &value));
        if (strcmp(key.name, "folder") != 0) assert_true(*comment);
    }
    assert_true(n > 40);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(own_settings_hold_at_every_quality),
        cmocka_unit_test(unknown_keys),
        cmocka_unit_test(wrong_types),
        cmocka_unit_test(values_out_of_range),
        cmocka_unit_test(not_a_city_file),
        cmocka_unit_test(a_newer_version),
        cmocka_unit_test(paths),
        cmocka_unit_test(every_key_is_taken),
        cmocka_unit_test(template_shows_the_defaults),
        cmocka_unit_test(a_budget_chooses),
        cmocka_unit_test(the_table_is_whole),
        cmocka_unit_test(template_takes_any_name),
    };
    return cmocka_run_group_tests(tests, make_folder, remove_folder);
}
