/* The record of an artefact's inputs is kept in full, however long it is. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>

#include "base/file.h"
#include "base/hash.h"
#include "record/record.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

enum { LONG = 5000, MANY = 120 };

static void long_text(char text[LONG + 1], char last)
{
    memset(text, 'a', LONG);
    text[LONG - 1] = last;
    text[LONG] = 0;
}

static void a_hash_is_of_the_whole_text(void **state)
{
    (void)state;
    char a[LONG + 1], b[LONG + 1];
    long_text(a, 'x');
    long_text(b, 'y');
    assert_true(cn_hash_text(7, "%s", a) == cn_hash_text(7, "%s", a));
    assert_true(cn_hash_text(7, "%s", a) != cn_hash_text(7, "%s", b));
    assert_true(cn_hash_text(7, "%s", a) != cn_hash_text(8, "%s", a));
}

/* 120 settings, each with a value of 5000 characters; the last character of one is another in `changed`. */
static cn_stage stage_of(int changed)
{
    cn_stage stage = { .record = "stage.json", .made = { "made" } };
    char name[32], text[LONG + 1];
    for (int i = 0; i < MANY; i++) {
        snprintf(name, sizeof name, "section.setting_%d", i);
        long_text(text, i == changed ? 'y' : 'x');
        cn_fingerprint_add(&stage.config, name, "%s", text);
    }
    return stage;
}

static void every_change_is_seen_and_named(void **state)
{
    (void)state;
    char folder[] = "/tmp/conurb-record-XXXXXX", path[64], reason[CN_REASON_SIZE], name[40];
    assert_non_null(mkdtemp(folder));
    const cn_city city = { .folder = folder };
    snprintf(path, sizeof path, "%s/made", folder);
    assert_int_equal(cn_file_write(path, "1", 1), CN_OK);
    const cn_stage as_made = stage_of(-1);
    assert_int_equal(cn_stage_finish(&city, &as_made), CN_OK);
    assert_true(cn_stage_done(&city, &as_made, reason));
    const int changes[] = { 0, 1, 50, MANY - 1 };
    for (size_t i = 0; i < sizeof changes / sizeof *changes; i++) {
        const cn_stage other = stage_of(changes[i]);
        assert_false(cn_stage_done(&city, &other, reason));
        snprintf(name, sizeof name, "section.setting_%d is", changes[i]);
        assert_non_null(strstr(reason, name));
    }
    unlink(path);
    snprintf(path, sizeof path, "%s/stage.json", folder);
    unlink(path);
    rmdir(folder);
}

static void expect_reason(const cn_city *city, const char *name, const char *value, const char *reason)
{
    cn_stage stage = { .record = "stage.json", .made = { "made" } };
    char said[CN_REASON_SIZE];
    cn_fingerprint_add(&stage.config, name, "%s", value);
    assert_false(cn_stage_done(city, &stage, said));
    assert_string_equal(said, reason);
}

/* A reason has the words of city.yaml, not the numbers of an enum. */
static void a_reason_speaks_as_city_yaml_does(void **state)
{
    (void)state;
    char folder[] = "/tmp/conurb-record-XXXXXX", path[64];
    assert_non_null(mkdtemp(folder));
    const cn_city city = { .folder = folder };
    snprintf(path, sizeof path, "%s/made", folder);
    assert_int_equal(cn_file_write(path, "1", 1), CN_OK);
    cn_stage stage = { .record = "stage.json", .made = { "made" } };
    cn_fingerprint_add(&stage.config, "poses.matcher", "0");
    cn_fingerprint_add(&stage.config, "poses.single_camera", "1");
    cn_fingerprint_add(&stage.config, "train.steps", "60");
    cn_fingerprint_add(&stage.config, "effects.sky", "auto");
    cn_fingerprint_add(&stage.config, "plan.centres", "%s", "");
    assert_int_equal(cn_stage_finish(&city, &stage), CN_OK);
    expect_reason(&city, "poses.matcher", "3", "poses.matcher is sequential, was auto");
    expect_reason(&city, "poses.single_camera", "0", "poses.single_camera is off, was on");
    expect_reason(&city, "train.steps", "70", "train.steps is 70, was 60");
    expect_reason(&city, "effects.sky", "off", "effects.sky is off, was auto");
    expect_reason(&city, "plan.centres", "a.geojson", "plan.centres is a.geojson, was empty");
    /* A value that is no longer there is named too. */
    expect_reason(&city, "poses.matcher", "0", "effects.sky changed");
    assert_int_equal(cn_folder_remove(folder), CN_OK);
}

/* Imported poses depend on all files that they are read from. */
static void the_list_of_a_bundle_is_an_input(void **state)
{
    (void)state;
    char folder[] = "/tmp/conurb-record-XXXXXX", bundle[64], list[64];
    static cn_stage before, after;
    const cn_photo_index index = { 0 };
    assert_non_null(mkdtemp(folder));
    snprintf(bundle, sizeof bundle, "%s/x.bundle.out", folder);
    snprintf(list, sizeof list, "%s/x.list.txt", folder);
    assert_int_equal(cn_file_write(bundle, "# Bundle file v0.3", 18), CN_OK);
    assert_int_equal(cn_file_write(list, "a.jpg", 5), CN_OK);
    const cn_city city = { .folder = folder, .config = { .import = bundle } };
    assert_int_equal(cn_stage_poses(&city, &index, &before), CN_OK);
    assert_int_equal(cn_stage_poses(&city, &index, &after), CN_OK);
    assert_true(cn_stage_hash(&before) == cn_stage_hash(&after));
    assert_int_equal(cn_file_write(list, "b.jpg", 5), CN_OK);
    assert_int_equal(cn_stage_poses(&city, &index, &after), CN_OK);
    assert_true(cn_stage_hash(&before) != cn_stage_hash(&after));
    assert_int_equal(unlink(bundle), 0);
    assert_int_equal(unlink(list), 0);
    assert_int_equal(rmdir(folder), 0);
}

static void put(const char *folder, const char *name, const char *text)
{
    char path[128];
    snprintf(path, sizeof path, "%s/%s", folder, name);
    assert_int_equal(cn_folder_of_make(path), CN_OK);
    assert_int_equal(cn_file_write(path, text, strlen(text)), CN_OK);
}

static uint64_t hash_of_import(const char *import)
{
    static cn_stage poses;
    char folder[] = "/tmp", path[64];
    const cn_photo_index index = { 0 };
    snprintf(path, sizeof path, "%s", import);
    const cn_city city = { .folder = folder, .config = { .import = path } };
    assert_int_equal(cn_stage_poses(&city, &index, &poses), CN_OK);
    return cn_stage_hash(&poses);
}

/* An import that is exported again is read again, wherever in its folder its files lie. */
static void the_files_of_an_import_are_inputs(void **state)
{
    (void)state;
    static const struct {
        const char *changed, *text, *beside;
    } CASES[] = {
        { "sparse/0/images.bin", "\1", "sparse/0/cameras.bin" },
        { "cameras.xml", "<document>", NULL },
        { "metadata", "{}", NULL },
        { "EXR_RGBD/metadata", "{}", NULL },
        { "keyframes/corrected_cameras/1.json", "{}", "keyframes/cameras/1.json" },
        { "cameras/2.json", "{}", "cameras/1.json" },
        { "list.txt", "a.jpg", "bundle/bundle.out" },
        { "images.bin", "\1", "cameras.bin" },
        { "opensfm/reconstruction.json", "[]", NULL },
    };
    for (size_t i = 0; i < sizeof CASES / sizeof *CASES; i++) {
        const bool bundle = strcmp(CASES[i].changed, "list.txt") == 0;
        char folder[] = "/tmp/conurb-record-XXXXXX", path[128];
        assert_non_null(mkdtemp(folder));
        char bytes[8] = { 1 };
        snprintf(path, sizeof path, "%s/%s", folder, CASES[i].changed);
        if (CASES[i].beside) put(folder, CASES[i].beside, bundle ? "# Bundle file v0.3" : "1");
        put(folder, CASES[i].changed, CASES[i].text);
        /* A model's images begin with their number. */
        if (strstr(CASES[i].changed, "images.bin")) assert_int_equal(cn_file_write(path, bytes, sizeof bytes), CN_OK);
        const uint64_t before = hash_of_import(folder);
        assert_true(hash_of_import(folder) == before);
        bytes[4] = 1;
        assert_int_equal(cn_file_write(path, bytes, sizeof bytes), CN_OK);
        assert_true(hash_of_import(folder) != before);
        assert_int_equal(cn_folder_remove(folder), CN_OK);
    }
}

static uint64_t hash_of_plan(const char *folder)
{
    static cn_stage plan;
    char path[64];
    snprintf(path, sizeof path, "%s", folder);
    const cn_city city = { .folder = path };
    assert_int_equal(cn_stage_plan(&city, &plan), CN_OK);
    return cn_stage_hash(&plan);
}

/* A record of an import whose files lie in its folder itself, as an older Conurb wrote it, holds. */
static void older_records_of_imports_hold(void **state)
{
    (void)state;
    static const char *const NAMES[] = { "cameras.bin", "images.bin", "points3D.bin" };
    static cn_stage poses;
    char folder[] = "/tmp/conurb-record-XXXXXX", path[64], hex[17], line[64];
    uint64_t hash = 0, one;
    const cn_photo_index index = { 0 };
    assert_non_null(mkdtemp(folder));
    for (int i = 0; i < 3; i++) {
        const char bytes[8] = { 1 };
        snprintf(path, sizeof path, "%s/%s", folder, NAMES[i]);
        assert_int_equal(cn_file_write(path, bytes, sizeof bytes), CN_OK);
        assert_int_equal(cn_hash_file(path, &one), CN_OK);
        cn_hash_hex(one, hex);
        hash = cn_hash_text(hash, "%s %s", NAMES[i], hex);
    }
    const cn_city city = { .folder = folder, .config = { .import = folder } };
    assert_int_equal(cn_stage_poses(&city, &index, &poses), CN_OK);
    cn_hash_hex(hash, hex);
    snprintf(line, sizeof line, "the imported poses=%s", hex);
    assert_non_null(strstr(poses.parent.text, line));
    assert_int_equal(cn_folder_remove(folder), CN_OK);
}

/* The plan, and by it the tiles, depend on the masks' bytes, not only on their names. */
static void masks_are_inputs(void **state)
{
    (void)state;
    char folder[] = "/tmp/conurb-record-XXXXXX", path[64];
    cn_photo photo = { .name = "a.jpg", .width = 1, .height = 1, .orientation = 1, .camera = "" };
    assert_non_null(mkdtemp(folder));
    const cn_photo_index index = { .folder = folder, .photos = &photo, .n_photos = 1 };
    static const char *const parents[] = { "frame.json", "poses/model/images.bin", "poses/model/points3D.bin" };
    for (int i = 0; i < 3; i++)
        put(folder, parents[i], "1");
    snprintf(path, sizeof path, "%s/photos.json", folder);
    put(folder, "masks/a.jpg.png", "1");
    assert_int_equal(cn_photo_index_save(&index, path), CN_OK);
    const uint64_t without = hash_of_plan(folder);
    put(folder, "masks/a.jpg.png", "2");
    assert_true(hash_of_plan(folder) == without);
    photo.mask = "masks/a.jpg.png";
    assert_int_equal(cn_photo_index_save(&index, path), CN_OK);
    const uint64_t with = hash_of_plan(folder);
    assert_true(with != without);
    put(folder, "masks/a.jpg.png", "3");
    assert_true(hash_of_plan(folder) != with);
    put(folder, "masks/a.jpg.png", "2");
    assert_true(hash_of_plan(folder) == with);
    /* A mask that is gone is said when the photos are read. */
    snprintf(path, sizeof path, "%s/masks/a.jpg.png", folder);
    assert_int_equal(unlink(path), 0);
    assert_true(hash_of_plan(folder) != with);
    assert_int_equal(cn_folder_remove(folder), CN_OK);
}

int main(void)
{
    const struct CMUnitTest tests[] = { cmocka_unit_test(a_hash_is_of_the_whole_text),
                                        cmocka_unit_test(every_change_is_seen_and_named),
                                        cmocka_unit_test(the_list_of_a_bundle_is_an_input),
                                        cmocka_unit_test(the_files_of_an_import_are_inputs),
                                        cmocka_unit_test(a_reason_speaks_as_city_yaml_does),
                                        cmocka_unit_test(older_records_of_imports_hold),
                                        cmocka_unit_test(masks_are_inputs) };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
