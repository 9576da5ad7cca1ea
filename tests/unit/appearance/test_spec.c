/* Appearances by name: what a name stands for, and the messages for names that cannot be used. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>

#include "base/file.h"
#include "appearance/spec.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

static char folder[] = "/tmp/conurb-light-XXXXXX";
static struct cn_city city = { .folder = folder };
static cn_photo photos[2] = { { .name = "noon.jpg" }, { .name = "west/dusk.jpg" } };
static const cn_photo_index photo_index = { .photos = photos, .n_photos = 2 };

static int make(void **state)
{
    (void)state;
    return mkdtemp(folder) ? 0 : -1;
}

static int unmake(void **state)
{
    (void)state;
    char path[128];
    snprintf(path, sizeof path, "%s/appearances/mist.json", folder);
    unlink(path);
    snprintf(path, sizeof path, "%s/appearances", folder);
    rmdir(path);
    snprintf(path, sizeof path, "%s/bad.json", folder);
    unlink(path);
    return rmdir(folder);
}

static cn_appearance_kind kind_of(const char *text)
{
    cn_appearance_spec spec;
    assert_int_equal(cn_appearance_spec_parse(&spec, text, &city, &photo_index), CN_OK);
    const cn_appearance_kind kind = spec.kind;
    cn_appearance_spec_deinit(&spec);
    return kind;
}

static void test_words(void **state)
{
    (void)state;
    assert_int_equal(kind_of(NULL), CN_APPEARANCE_MEAN);
    assert_int_equal(kind_of("mean"), CN_APPEARANCE_MEAN);
    assert_int_equal(kind_of("noon.jpg"), CN_APPEARANCE_PHOTO);
    assert_int_equal(kind_of("dusk.jpg"), CN_APPEARANCE_PHOTO); /* a bare name that is unique */
    assert_int_equal(kind_of("fit:noon.jpg"), CN_APPEARANCE_FIT);
    cn_appearance_spec spec;
    assert_int_equal(cn_appearance_spec_parse(&spec, "noon.jpg:west/dusk.jpg:0.3", &city, &photo_index), CN_OK);
    assert_int_equal(spec.kind, CN_APPEARANCE_MIX);
    assert_string_equal(spec.a, "noon.jpg");
    assert_string_equal(spec.b, "west/dusk.jpg");
    assert_true(fabs(spec.t - 0.3) < 1e-12);
    cn_appearance_spec_deinit(&spec);
}

/* A mix of more than two photos: each photo after the first is blended with the mix of those before it. */
static void test_mix_of_several(void **state)
{
    (void)state;
    cn_appearance_spec spec, pair;
    char text[256];
    assert_int_equal(
        cn_appearance_spec_parse(&spec, "noon.jpg:dusk.jpg:0.5:noon.jpg:0.25:dusk.jpg:0.1", &city, &photo_index),
        CN_OK);
    assert_int_equal(spec.kind, CN_APPEARANCE_MIX);
    assert_string_equal(spec.b, "west/dusk.jpg");
    assert_true(spec.t == 0.1 && spec.first->t == 0.25 && spec.first->first->t == 0.5);
    assert_string_equal(spec.first->b, "noon.jpg");
    assert_null(spec.first->first->first);
    cn_appearance_spec_describe(&spec, text, sizeof text);
    assert_string_equal(text, "noon.jpg:west/dusk.jpg:0.5:noon.jpg:0.25:west/dusk.jpg:0.1");
    assert_int_equal(cn_appearance_spec_parse(&pair, "noon.jpg:dusk.jpg:0.1", &city, &photo_index), CN_OK);
    assert_true(cn_appearance_spec_hash(&spec, 0) != cn_appearance_spec_hash(&pair, 0));
    cn_appearance_spec_deinit(&pair);
    cn_appearance_spec_deinit(&spec);
}

/* The mean and lights with a name can be parts of a mix, at any place. */
static void test_mix_of_other_lights(void **state)
{
    (void)state;
    cn_appearance_spec spec;
    char text[600], path[128];
    snprintf(path, sizeof path, "%s/views/fitted", folder);
    assert_int_equal(cn_folder_make(path), CN_OK);
    snprintf(path, sizeof path, "%s/views/fitted/rain.json", folder);
    assert_int_equal(cn_file_write(path, "{\"tiles\": {}}", 13), CN_OK);
    assert_int_equal(kind_of("rain"), CN_APPEARANCE_FILE);
    assert_int_equal(cn_appearance_spec_parse(&spec, "mean:rain:0.5:noon.jpg:0.25", &city, &photo_index), CN_OK);
    assert_int_equal(spec.kind, CN_APPEARANCE_MIX);
    assert_string_equal(spec.b, "noon.jpg");
    assert_null(spec.second);
    assert_int_equal(spec.first->first->kind, CN_APPEARANCE_MEAN);
    assert_int_equal(spec.first->second->kind, CN_APPEARANCE_FILE);
    cn_appearance_spec_describe(&spec, text, sizeof text);
    assert_non_null(strstr(text, "mean:"));
    const uint64_t hash = cn_appearance_spec_hash(&spec, 0);
    cn_appearance_spec_deinit(&spec);
    assert_int_equal(cn_appearance_spec_parse(&spec, "mean:mean:0.5:noon.jpg:0.25", &city, &photo_index), CN_OK);
    assert_true(cn_appearance_spec_hash(&spec, 0) != hash);
    cn_appearance_spec_deinit(&spec);
    unlink(path);
    snprintf(path, sizeof path, "%s/views/fitted", folder);
    rmdir(path);
    snprintf(path, sizeof path, "%s/views", folder);
    rmdir(path);
}

static void refuse(const char *text, const char *part)
{
    cn_appearance_spec spec;
    assert_int_not_equal(cn_appearance_spec_parse(&spec, text, &city, &photo_index), CN_OK);
    if (!strstr(cn_error_message(), part)) fail_msg("'%s' gives '%s'", text, cn_error_message());
    cn_appearance_spec_deinit(&spec);
}

static void test_nonsense(void **state)
{
    (void)state;
    refuse("night.jpg", "night.jpg");
    refuse("fit:night.jpg", "night.jpg");
    refuse("noon.jpg:dusk.jpg", "A:B:0.3");
    refuse("noon.jpg:dusk.jpg:x", "A:B:0.3");
    refuse("noon.jpg:dusk.jpg:0.5x", "A:B:0.3");
    refuse("noon.jpg:dusk.jpg:inf", "A:B:0.3");
    refuse("noon.jpg:night.jpg:0.5", "night.jpg");
    refuse("noon.jpg:dusk.jpg:0.5:noon.jpg", "A:B:0.3:C:0.2");
    refuse("noon.jpg:dusk.jpg:0.5:", "A:B:0.3:C:0.2");
    refuse("noon.jpg:dusk.jpg:0.5:night.jpg:0.5", "night.jpg");
    refuse("noon.jpg:noon.jpg:0:noon.jpg:0:noon.jpg:0:noon.jpg:0:noon.jpg:0:noon.jpg:0:noon.jpg:0:noon.jpg:0:"
           "noon.jpg:0:noon.jpg:0:noon.jpg:0:noon.jpg:0:noon.jpg:0:noon.jpg:0:noon.jpg:0:noon.jpg:0",
           "up to 16");
    refuse("missing.json", "missing.json");
    char path[128];
    snprintf(path, sizeof path, "%s/bad.json", folder);
    assert_int_equal(cn_file_write(path, "{\"tiles\": 3}", 12), CN_OK);
    refuse(path, "holds no appearance");
}

static void test_imported_names(void **state)
{
    (void)state;
    char path[128];
    snprintf(path, sizeof path, "%s/appearances", folder);
    assert_int_equal(cn_folder_make(path), CN_OK);
    snprintf(path, sizeof path, "%s/appearances/mist.json", folder);
    assert_int_equal(cn_file_write(path, "{\"tiles\": {}}", 13), CN_OK);
    assert_int_equal(kind_of("mist"), CN_APPEARANCE_FILE);
    refuse("../appearances/mist", "mist"); /* a name is not a path */
}

static void test_sequences(void **state)
{
    (void)state;
    cn_appearance_spec *specs;
    uint32_t n;
    assert_int_equal(cn_appearance_specs_parse(&specs, &n, "noon.jpg,dusk.jpg,mean", &city, &photo_index), CN_OK);
    assert_int_equal(n, 3);
    enum { FRAMES = 9 };
    double last = -1;
    for (uint32_t i = 0; i < FRAMES; i++) {
        const cn_appearance_spec l = cn_appearance_specs_at(specs, n, i, FRAMES);
        const double place = (double)(l.from - specs) + l.t;
        assert_true(l.to == l.from + 1 && place > last); /* onward, without a step back */
        last = place;
    }
    assert_true(fabs(last - 2) < 1e-12);
    const cn_appearance_spec middle = cn_appearance_specs_at(specs, n, 4, FRAMES);
    assert_true(fabs((double)(middle.from - specs) + middle.t - 1) < 1e-12); /* each light is reached */
    char text[640];
    const cn_appearance_spec between = cn_appearance_specs_at(specs, n, 2, FRAMES);
    cn_appearance_spec_describe(&between, text, sizeof text);
    assert_string_equal(text, "noon.jpg:west/dusk.jpg:0.5");
    assert_true(cn_appearance_spec_hash(&between, 0) != cn_appearance_spec_hash(&middle, 0));
    cn_appearance_specs_free(specs, n);
    assert_int_not_equal(cn_appearance_specs_parse(&specs, &n, "noon.jpg,night.jpg", &city, &photo_index), CN_OK);
    assert_null(specs);
    assert_int_equal(n, 0);
}

/* JSON, and the metadata of pictures and meshes, must be UTF-8; paths need not be. A text that is cut, too. */
static void test_descriptions_are_utf8(void **state)
{
    (void)state;
    const cn_appearance_spec spec = { .kind = CN_APPEARANCE_FILE, .a = "caf\xe9/\xc3\xa9t\xc3\xa9.json" };
    char text[640];
    cn_appearance_spec_describe(&spec, text, sizeof text);
    assert_string_equal(text, "caf?/\xc3\xa9t\xc3\xa9.json");
    cn_appearance_spec_describe(&spec, text, 7);
    assert_string_equal(text, "caf?/?");
}

/* A photo with a comma in its name, alone, in a mix, and beside photos that the parts of its name name. */
static void test_sequences_of_names_with_commas(void **state)
{
    (void)state;
    static cn_photo odd[3] = { { .name = "noon.jpg" }, { .name = "noon.jpg,2.jpg" }, { .name = "2.jpg" } };
    static const cn_photo_index index = { .photos = odd, .n_photos = 3 };
    static const char *const sequences[] = { "noon.jpg,2.jpg,noon.jpg", "mean,noon.jpg,2.jpg",
                                             "fit:noon.jpg,2.jpg,noon.jpg,2.jpg:mean:0.3", "2.jpg,noon.jpg" };
    static const char *const first[] = { "noon.jpg,2.jpg", "mean", "fit:noon.jpg,2.jpg", "2.jpg" };
    static const char *const second[] = { "noon.jpg", "noon.jpg,2.jpg", "noon.jpg,2.jpg:mean:0.3", "noon.jpg" };
    for (size_t i = 0; i < sizeof sequences / sizeof *sequences; i++) {
        cn_appearance_spec *specs;
        uint32_t n;
        char text[640];
        assert_int_equal(cn_appearance_specs_parse(&specs, &n, sequences[i], &city, &index), CN_OK);
        assert_int_equal(n, 2);
        cn_appearance_spec_describe(&specs[0], text, sizeof text);
        assert_string_equal(text, first[i]);
        cn_appearance_spec_describe(&specs[1], text, sizeof text);
        assert_string_equal(text, second[i]);
        cn_appearance_specs_free(specs, n);
    }
    cn_appearance_spec *specs;
    uint32_t n;
    assert_int_equal(cn_appearance_specs_parse(&specs, &n, "noon.jpg,2.jpg,", &city, &index), CN_ERR_USAGE);
    assert_int_equal(cn_appearance_specs_parse(&specs, &n, "noon.jpg,night.jpg,2.jpg", &city, &index), CN_ERR_USAGE);
    assert_non_null(strstr(cn_error_message(), "'night.jpg'"));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_words),
        cmocka_unit_test(test_mix_of_several),
        cmocka_unit_test(test_mix_of_other_lights),
        cmocka_unit_test(test_nonsense),
        cmocka_unit_test(test_imported_names),
        cmocka_unit_test(test_sequences),
        cmocka_unit_test(test_sequences_of_names_with_commas),
        cmocka_unit_test(test_descriptions_are_utf8),
    };
    return cmocka_run_group_tests(tests, make, unmake);
}
