#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>

#include "scratch.h"

#include "base/file.h"
#include "base/rng.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static void note(void *user, cn_log_level level, const char *text)
{
    log_append(((scratch *)user)->logged, level, text);
}

static void report(void *user, const cn_progress_report *r)
{
    scratch *s = user;
    s->reports++;
    s->last = r->done;
    s->total = r->total;
}

int scratch_set_up(void **state)
{
    scratch *s = calloc(1, sizeof *s);
    if (!s) return -1;
    *state = s;
    strcpy(s->folder, "/tmp/conurb-photo-XXXXXX");
    if (!mkdtemp(s->folder) || cn_pool_create(&s->pool, 2) != CN_OK) return -1;
    s->context = (cn_context){ .pool = s->pool, .log = note, .progress = report, .user = s };
    return 0;
}

int scratch_tear_down(void **state)
{
    scratch *s = *state;
    const int failed = folder_remove(s->folder);
    cn_pool_destroy(&s->pool);
    free(s);
    return failed;
}

const char *scratch_path(scratch *s, const char *name)
{
    static char paths[4][256];
    static int turn;
    char *path = paths[turn++ % 4];
    snprintf(path, sizeof paths[0], "%s/%s", s->folder, name);
    char *slash = strrchr(path, '/');
    *slash = 0;
    assert_int_equal(cn_folder_make(path), CN_OK);
    *slash = '/';
    return path;
}

void scratch_photo(scratch *s, const char *name, unsigned seed, const cn_oiio_attribute *attributes)
{
    enum { N = SCRATCH_W * SCRATCH_H };
    float rgb[N * 3], rgba[N * 4];
    for (unsigned i = 0; i < N; i++)
        for (unsigned c = 0; c < 3; c++)
            rgba[4 * i + c] = rgb[3 * i + c] = cn_rng_float(seed, c, i);
    for (unsigned i = 0; i < N; i++)
        rgba[4 * i + 3] = 1;
    const char *path = scratch_path(s, name), *dot = strrchr(name, '.');
    const uint32_t w = SCRATCH_W, h = SCRATCH_H;
    if (strcmp(dot, ".png") == 0)
        assert_int_equal(cn_oiio_write_png(path, rgb, w, h, 3, attributes), CN_OK);
    else if (strcmp(dot, ".tif") == 0)
        assert_int_equal(cn_oiio_write_tiff(path, rgb, w, h, attributes), CN_OK);
    else if (strcmp(dot, ".exr") == 0)
        assert_int_equal(cn_oiio_write_exr(path, rgba, NULL, w, h, attributes), CN_OK);
    else
        assert_int_equal(cn_oiio_write_jpeg(path, rgb, w, h, attributes), CN_OK);
}

void scratch_copy(scratch *s, const char *from, const char *to, double share)
{
    char *data;
    size_t size;
    assert_int_equal(cn_file_read(scratch_path(s, from), 0, &data, &size), CN_OK);
    assert_int_equal(cn_file_write(scratch_path(s, to), data, (size_t)((double)size * share)), CN_OK);
    free(data);
}
