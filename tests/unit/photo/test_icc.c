/* Photos with ICC profiles: the pixel store holds what Little CMS makes of the same file, in floats, by the relative
 * colorimetric intent. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>

#include "scratch.h"
#include "segment.h"

#include "base/file.h"
#include "bridge/exiv2.h"
#include "colour/icc.h"
#include "photo/store.h"

#include <lcms2.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { SIDE = 48, PIXELS = SIDE * SIDE };

static const cmsCIExyY D65 = { 0.3127, 0.3290, 1 }, D50 = { 0.345704, 0.358540, 1 }, D60 = { 0.32168, 0.33767, 1 };
static const cmsCIExyYTRIPLE REC709 = { { 0.64, 0.33, 1 }, { 0.30, 0.60, 1 }, { 0.15, 0.06, 1 } };
static const cmsCIExyYTRIPLE P3 = { { 0.68, 0.32, 1 }, { 0.265, 0.69, 1 }, { 0.15, 0.06, 1 } };
static const cmsCIExyYTRIPLE ADOBE = { { 0.64, 0.33, 1 }, { 0.21, 0.71, 1 }, { 0.15, 0.06, 1 } };
static const cmsCIExyYTRIPLE PROPHOTO = { { 0.734699, 0.265301, 1 },
                                          { 0.159597, 0.840403, 1 },
                                          { 0.036598, 0.000105, 1 } };
static const cmsCIExyYTRIPLE REC2020 = { { 0.708, 0.292, 1 }, { 0.170, 0.797, 1 }, { 0.131, 0.046, 1 } };
static const cmsCIExyYTRIPLE AP1 = { { 0.713, 0.293, 1 }, { 0.165, 0.830, 1 }, { 0.128, 0.044, 1 } };

/* The parametric curve of kind 4: ((a v + b)^g above d, c v below), or a plain power for one number. */
static cmsToneCurve *curve_of(const double p[5])
{
    if (p[1] == 0) return cmsBuildGamma(NULL, p[0]);
    return cmsBuildParametricToneCurve(NULL, 4, p);
}
static const double SRGB_CURVE[5] = { 2.4, 1 / 1.055, 0.055 / 1.055, 1 / 12.92, 0.04045 };
static const double REC2020_CURVE[5] = { 1 / 0.45, 1 / 1.09929682680944, 0.09929682680944 / 1.09929682680944, 1 / 4.5,
                                         4.5 * 0.018053968510807 };
static const double PROPHOTO_TOE[5] = { 1.8, 1, 1e-12, 1 / 16.0, 16 / 512.0 };

static cmsHPROFILE rgb_profile(const cmsCIExyY *white, const cmsCIExyYTRIPLE *primaries, const double red[5],
                               const double others[5])
{
    cmsToneCurve *a = curve_of(red), *b = curve_of(others), *curves[3] = { a, b, b };
    cmsHPROFILE profile = cmsCreateRGBProfile(white, primaries, curves);
    assert_non_null(profile);
    cmsFreeToneCurve(a);
    cmsFreeToneCurve(b);
    return profile;
}

static void *bytes_of(cmsHPROFILE profile, size_t *size)
{
    cmsUInt32Number n = 0;
    assert_true(cmsSaveProfileToMem(profile, NULL, &n));
    void *bytes = malloc(n);
    assert_true(bytes && cmsSaveProfileToMem(profile, bytes, &n));
    *size = n;
    return bytes;
}

static const char *space_of(cmsHPROFILE profile, uint32_t channels)
{
    size_t size;
    void *bytes = bytes_of(profile, &size);
    cn_icc *icc;
    assert_int_equal(cn_icc_create(&icc, bytes, size, channels), CN_OK);
    free(bytes);
    const char *space = cn_icc_space(icc);
    cn_icc_destroy(&icc);
    return space;
}

static void expect_space(cmsHPROFILE profile, const char *want)
{
    const char *space = space_of(profile, 3);
    if (want)
        assert_true(space && strcmp(space, want) == 0);
    else
        assert_null(space);
    cmsCloseProfile(profile);
}

static void known_spaces_are_told_by_primaries_and_curve(void **state)
{
    (void)state;
    static const double adobe[5] = { 563 / 256.0 }, plain[5] = { 2.2 }, prophoto[5] = { 1.8 },
                        rounded[5] = { 461 / 256.0 };
    expect_space(cmsCreate_sRGBProfile(), "sRGB");
    expect_space(rgb_profile(&D65, &P3, SRGB_CURVE, SRGB_CURVE), "Display P3");
    expect_space(rgb_profile(&D65, &ADOBE, adobe, adobe), "Adobe RGB (1998)");
    expect_space(rgb_profile(&D50, &PROPHOTO, prophoto, prophoto), "ProPhoto RGB");
    expect_space(rgb_profile(&D50, &PROPHOTO, rounded, rounded), "ProPhoto RGB");
    expect_space(rgb_profile(&D65, &REC2020, REC2020_CURVE, REC2020_CURVE), "Rec.2020");
    /* Close to a known space, but different. */
    expect_space(rgb_profile(&D65, &REC709, plain, plain), NULL);
    expect_space(rgb_profile(&D65, &P3, SRGB_CURVE, plain), NULL);
    expect_space(rgb_profile(&D50, &P3, SRGB_CURVE, SRGB_CURVE), NULL);
    expect_space(rgb_profile(&D50, &PROPHOTO, PROPHOTO_TOE, PROPHOTO_TOE), NULL);
}

/* Many profiles have their curve as a table. */
static void a_curve_may_be_a_table(void **state)
{
    (void)state;
    cmsUInt16Number table[1024];
    cmsToneCurve *srgb = curve_of(SRGB_CURVE);
    for (int i = 0; i < 1024; i++)
        table[i] = (cmsUInt16Number)lrintf(65535 * cmsEvalToneCurveFloat(srgb, (float)i / 1023));
    cmsToneCurve *tabled = cmsBuildTabulatedToneCurve16(NULL, 1024, table), *curves[3] = { tabled, tabled, tabled };
    expect_space(cmsCreateRGBProfile(&D65, &P3, curves), "Display P3");
    cmsFreeToneCurve(tabled);
    cmsFreeToneCurve(srgb);
}

/* Every channel over its range, in all combinations. */
static void write_colours(const char *path, const cn_oiio_attribute *attributes)
{
    float rgb[PIXELS * 3];
    for (int y = 0; y < SIDE; y++)
        for (int x = 0; x < SIDE; x++) {
            float *p = rgb + 3 * (y * SIDE + x);
            p[0] = (float)x / (SIDE - 1);
            p[1] = (float)y / (SIDE - 1);
            p[2] = (float)((x / 4 + y / 4) % 12) / 11;
        }
    assert_int_equal(cn_oiio_write_jpeg(path, rgb, SIDE, SIDE, attributes), CN_OK);
}

static void by_lcms(const char *path, cmsHPROFILE profile, float *rgb)
{
    static const double linear[5] = { 1 };
    float *rgba;
    uint32_t w, h;
    assert_int_equal(cn_oiio_read_rgba(path, &rgba, &w, &h), CN_OK);
    for (int i = 0; i < PIXELS; i++)
        memcpy(rgb + 3 * i, rgba + 4 * i, 3 * sizeof *rgb);
    free(rgba);
    cmsHPROFILE acescg = rgb_profile(&D60, &AP1, linear, linear);
    cmsHTRANSFORM t = cmsCreateTransform(profile, TYPE_RGB_FLT, acescg, TYPE_RGB_FLT, INTENT_RELATIVE_COLORIMETRIC, 0);
    assert_non_null(t);
    cmsDoTransform(t, rgb, rgb, PIXELS);
    cmsDeleteTransform(t);
    cmsCloseProfile(acescg);
}

/* Halves keep 11 bits. The largest error allowed is 0.1 % of white. */
static void expect_lcms(scratch *s, cmsHPROFILE profile)
{
    float want[PIXELS * 3], *got = malloc(PIXELS * 4 * sizeof *got);
    const char *path = scratch_path(s, "a.jpg");
    size_t size;
    void *bytes = bytes_of(profile, &size);
    write_colours(path, NULL);
    segment_profile(path, bytes, size);
    void *read;
    size_t read_size;
    assert_int_equal(cn_exiv2_read_icc(path, &read, &read_size), CN_OK);
    assert_int_equal(read_size, size);
    assert_memory_equal(read, bytes, size);
    free(read);
    free(bytes);
    by_lcms(path, profile, want);
    cmsCloseProfile(profile);
    cn_photo_index index;
    cn_pixel_store *store;
    char pixels[256];
    snprintf(pixels, sizeof pixels, "%s", scratch_path(s, "pixels"));
    assert_int_equal(cn_photo_index_scan(&s->context, s->folder, &index), CN_OK);
    assert_int_equal(cn_pixel_store_build(&s->context, &index, SIDE, pixels), CN_OK);
    assert_int_equal(cn_pixel_store_open(&store, pixels), CN_OK);
    assert_int_equal(cn_pixel_store_read(store, 0, got), CN_OK);
    double worst = 0;
    for (int i = 0; i < PIXELS; i++)
        for (int c = 0; c < 3; c++)
            worst = fmax(worst, fabs((double)got[4 * i + c] - (double)want[3 * i + c]));
    print_message("largest difference %.2g\n", worst);
    assert_true(worst < 1e-3);
    assert_null(strstr(s->logged, "profile"));
    cn_pixel_store_close(&store);
    cn_photo_index_deinit(&index);
    free(got);
}

static void photos_become_what_lcms_makes_of_them(void **state)
{
    scratch *s = *state;
    static const double adobe[5] = { 563 / 256.0 }, prophoto[5] = { 1.8 }, odd[5] = { 2.6 }, plain[5] = { 2.2 };
    expect_lcms(s, cmsCreate_sRGBProfile());
    expect_lcms(s, rgb_profile(&D65, &P3, SRGB_CURVE, SRGB_CURVE));
    expect_lcms(s, rgb_profile(&D65, &ADOBE, adobe, adobe));
    expect_lcms(s, rgb_profile(&D50, &PROPHOTO, prophoto, prophoto));
    expect_lcms(s, rgb_profile(&D65, &REC2020, REC2020_CURVE, REC2020_CURVE));
    /* Not a known space, so it goes through lcms. */
    expect_lcms(s, rgb_profile(&D65, &REC709, plain, plain));
    expect_lcms(s, rgb_profile(&D60, &P3, odd, SRGB_CURVE));
    expect_lcms(s, rgb_profile(&D50, &PROPHOTO, PROPHOTO_TOE, PROPHOTO_TOE));
}

static void grey_goes_by_its_curve(void **state)
{
    (void)state;
    cmsToneCurve *curve = cmsBuildGamma(NULL, 1.8);
    cmsHPROFILE profile = cmsCreateGrayProfile(cmsD50_xyY(), curve);
    cmsFreeToneCurve(curve);
    size_t size;
    void *bytes = bytes_of(profile, &size);
    cmsCloseProfile(profile);
    cn_icc *icc;
    cn_colour *own;
    assert_int_equal(cn_icc_create(&icc, bytes, size, 3), CN_ERR_FORMAT); /* a picture of colours */
    assert_int_equal(cn_icc_create(&icc, bytes, size, 1), CN_OK);
    assert_int_equal(cn_colour_create(&own, ""), CN_OK);
    float pixels[2 * 4] = { 0.5f, 0.5f, 0.5f, 0.25f, NAN, 0, 0, 1 };
    assert_int_equal(cn_icc_to_linear(icc, own, pixels, 2, 4), CN_OK);
    for (int c = 0; c < 3; c++) {
        assert_true(fabs((double)pixels[c] - pow(0.5, 1.8)) < 1e-4);
        assert_true(fabs((double)pixels[4 + c]) < 1e-6);
    }
    assert_true(pixels[3] == 0.25f && pixels[7] == 1);
    cn_colour_destroy(&own);
    cn_icc_destroy(&icc);
    free(bytes);
}

static uint32_t count(const char *text, const char *word)
{
    uint32_t n = 0;
    for (; (text = strstr(text, word)); text += strlen(word))
        n++;
    return n;
}

/* Two cameras, five photos: two lines. The photos are as they are without a profile. */
static void a_profile_that_cannot_be_used_is_said_once_a_camera(void **state)
{
    scratch *s = *state;
    static const char *const cameras[2] = { "One", "Two" };
    for (int i = 0; i < 5; i++) {
        char name[16];
        snprintf(name, sizeof name, "%d.jpg", i);
        const double exposure = 1.0 / (i + 2);
        const cn_oiio_attribute attributes[] = { { "Model", cameras[i % 2], NULL, 0 },
                                                 { "ExposureTime", NULL, &exposure, 1 },
                                                 { NULL, NULL, NULL, 0 } };
        write_colours(scratch_path(s, name), attributes);
        if (i < 4) segment_profile(scratch_path(s, name), "this is no profile", 18);
    }
    cn_photo_index index;
    cn_pixel_store *store;
    float *broken = malloc(PIXELS * 4 * sizeof *broken), *plain = malloc(PIXELS * 4 * sizeof *plain);
    assert_int_equal(cn_photo_index_scan(&s->context, s->folder, &index), CN_OK);
    assert_int_equal(cn_pixel_store_build(&s->context, &index, SIDE, scratch_path(s, "pixels")), CN_OK);
    assert_int_equal(count(s->logged, "ICC profile"), 2);
    assert_non_null(strstr(s->logged, "0.jpg: its ICC profile is damaged"));
    assert_non_null(strstr(s->logged, "photos of One with the same fault: 2"));
    assert_non_null(strstr(s->logged, "photos of Two with the same fault: 2"));
    assert_int_equal(cn_pixel_store_open(&store, scratch_path(s, "pixels")), CN_OK);
    assert_int_equal(cn_pixel_store_read(store, 0, broken), CN_OK);
    assert_int_equal(cn_pixel_store_read(store, 4, plain), CN_OK);
    assert_memory_equal(broken, plain, PIXELS * 4 * sizeof *plain);
    cn_pixel_store_close(&store);
    cn_photo_index_deinit(&index);
    free(broken);
    free(plain);
}

/* An older Conurb stored photos without regard to their profiles. */
static void a_store_of_the_first_version_is_made_again(void **state)
{
    scratch *s = *state;
    const char *path = scratch_path(s, "pixels");
    write_colours(scratch_path(s, "a.jpg"), NULL);
    cn_photo_index index;
    assert_int_equal(cn_photo_index_scan(&s->context, s->folder, &index), CN_OK);
    assert_int_equal(cn_pixel_store_build(&s->context, &index, SIDE, path), CN_OK);
    assert_null(strstr(s->logged, "older"));
    FILE *f = fopen(path, "r+b");
    const uint16_t first = 1;
    uint16_t version = 0;
    assert_true(f && fseek(f, offsetof(cn_store_header, version), SEEK_SET) == 0 && fwrite(&first, 2, 1, f) == 1);
    assert_int_equal(fclose(f), 0);
    cn_pixel_store *store;
    assert_int_equal(cn_pixel_store_open(&store, path), CN_OK); /* it can be read */
    cn_pixel_store_close(&store);
    assert_int_equal(cn_pixel_store_build(&s->context, &index, SIDE, path), CN_OK);
    assert_non_null(strstr(s->logged, "older"));
    f = fopen(path, "rb");
    assert_true(f && fseek(f, offsetof(cn_store_header, version), SEEK_SET) == 0 && fread(&version, 2, 1, f) == 1);
    fclose(f);
    assert_int_equal(version, CN_STORE_PLAIN);
    cn_photo_index_deinit(&index);
}

/* As cameras write it that name the space in EXIF alone: ColorSpace 65535, "uncalibrated", and R03 in the
 * interoperability folder (DCF 2.0, option file). */
static void write_exif_space(const char *path, const char *interop)
{
    static const uint8_t head[] = "\xff\xe1\0\x52"
                                  "Exif\0\0"
                                  "II*\0\x08\0\0\0"
                                  "\1\0\x69\x87\4\0\1\0\0\0\x1a\0\0\0"
                                  "\0\0\0\0"
                                  "\2\0\x01\xa0\3\0\1\0\0\0\xff\xff\0\0"
                                  "\x05\xa0\4\0\1\0\0\0\x38\0\0\0"
                                  "\0\0\0\0"
                                  "\1\0\1\0\2\0\4\0\0\0";
    char *bytes;
    size_t size;
    write_colours(path, NULL);
    assert_int_equal(cn_file_read(path, 1 << 24, &bytes, &size), CN_OK);
    FILE *f = fopen(path, "wb");
    assert_non_null(f);
    fwrite(bytes, 1, 2, f);
    fwrite(head, 1, sizeof head - 1, f);
    fwrite(interop, 1, 4, f);
    fwrite("\0\0\0\0", 1, 4, f);
    fwrite(bytes + 2, 1, size - 2, f);
    assert_int_equal(fclose(f), 0);
    free(bytes);
}

static void exif_may_name_adobe_rgb(void **state)
{
    scratch *s = *state;
    static const double adobe[5] = { 563 / 256.0 };
    float want[2][PIXELS * 3], *got = malloc(PIXELS * 4 * sizeof *got);
    write_exif_space(scratch_path(s, "a.jpg"), "R03");
    write_exif_space(scratch_path(s, "b.jpg"), "R98");
    cmsHPROFILE profiles[2] = { rgb_profile(&D65, &ADOBE, adobe, adobe), cmsCreate_sRGBProfile() };
    by_lcms(scratch_path(s, "a.jpg"), profiles[0], want[0]);
    by_lcms(scratch_path(s, "b.jpg"), profiles[1], want[1]);
    cmsCloseProfile(profiles[0]);
    cmsCloseProfile(profiles[1]);
    cn_photo_index index;
    cn_pixel_store *store;
    char pixels[256];
    snprintf(pixels, sizeof pixels, "%s", scratch_path(s, "pixels"));
    assert_int_equal(cn_photo_index_scan(&s->context, s->folder, &index), CN_OK);
    assert_int_equal(cn_pixel_store_build(&s->context, &index, SIDE, pixels), CN_OK);
    assert_int_equal(cn_pixel_store_open(&store, pixels), CN_OK);
    for (uint32_t photo = 0; photo < 2; photo++) {
        assert_int_equal(cn_pixel_store_read(store, photo, got), CN_OK);
        for (int i = 0; i < PIXELS * 3; i++)
            assert_true(fabs((double)got[i / 3 * 4 + i % 3] - (double)want[photo][i]) < 1e-3);
    }
    cn_pixel_store_close(&store);
    cn_photo_index_deinit(&index);
    free(got);
}

#define TEST(f) cmocka_unit_test_setup_teardown(f, scratch_set_up, scratch_tear_down)
int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(known_spaces_are_told_by_primaries_and_curve),
        cmocka_unit_test(a_curve_may_be_a_table),
        TEST(photos_become_what_lcms_makes_of_them),
        cmocka_unit_test(grey_goes_by_its_curve),
        TEST(exif_may_name_adobe_rgb),
        TEST(a_profile_that_cannot_be_used_is_said_once_a_camera),
        TEST(a_store_of_the_first_version_is_made_again),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
