#include "synth/picture.h"

#include "base/rng.h"
#include "bridge/oiio.h"
#include "conurb/colour.h"
#include "math/linalg.h"
#include "pose/lens.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { SAMPLES = 4, STREAM_PIXEL = 7 };

cn_status cn_lens_table_init(cn_lens_table *table, const cn_camera *camera)
{
    const uint32_t w = camera->width + 1, h = camera->height + 1;
    *table = (cn_lens_table){ camera, camera->width, camera->height, (float)(1 / cn_lens_unpack(camera).fx),
                              malloc((size_t)w * h * 3 * sizeof(float)) };
    if (!table->directions) return cn_fail(CN_ERR_NOMEM, "out of memory for a lens of %u x %u pixels", w - 1, h - 1);
    for (uint32_t i = 0; i < w * h; i++) {
        double d[3];
        const cn_status status = cn_camera_unproject(camera, i % w, i / w, d);
        if (status != CN_OK) {
            cn_lens_table_deinit(table);
            return status;
        }
        for (uint32_t a = 0; a < 3; a++)
            table->directions[3 * (size_t)i + a] = (float)d[a];
    }
    return CN_OK;
}

void cn_lens_table_deinit(cn_lens_table *table)
{
    free(table->directions);
    table->directions = NULL;
}

cn_status cn_film_create(cn_film *film, uint32_t width, uint32_t height)
{
    const size_t n = (size_t)width * height;
    *film = (cn_film){ calloc(n, 3 * sizeof(float)), calloc(n, 3 * sizeof(float)), calloc(n, sizeof(float)),
                       calloc(n, sizeof(float)) };
    if (film->seen && film->clean && film->distance_m && film->still) return CN_OK;
    cn_film_destroy(film);
    return cn_fail(CN_ERR_NOMEM, "out of memory for a photo of %u x %u pixels", width, height);
}

void cn_film_destroy(cn_film *film)
{
    free(film->seen);
    free(film->clean);
    free(film->distance_m);
    free(film->still);
    memset(film, 0, sizeof *film);
}

/* Direction in the world through a place of the picture: good to a thousandth of a pixel. */
static void direction(const cn_lens_table *lens, const double rotation[9], double x, double y, double out[3])
{
    const uint32_t ix = (uint32_t)x < lens->width ? (uint32_t)x : lens->width - 1;
    const uint32_t iy = (uint32_t)y < lens->height ? (uint32_t)y : lens->height - 1;
    const double u = x - ix, v = y - iy;
    const float *p = lens->directions + 3 * ((size_t)iy * (lens->width + 1) + ix),
                *q = p + 3 * ((size_t)lens->width + 1);
    double d[3];
    for (int a = 0; a < 3; a++)
        d[a] = (p[a] * (1 - u) + p[3 + a] * u) * (1 - v) + (q[a] * (1 - u) + q[3 + a] * u) * v;
    cn_mat3_tvec(rotation, d, out);
    cn_normalize3(out);
}

/* Exactly through a pixel's middle, for its depth. */
static void middle(const cn_lens_table *lens, const double rotation[9], uint32_t x, uint32_t y, double out[3])
{
    double d[3];
    if (cn_camera_unproject(lens->camera, x + 0.5, y + 0.5, d) == CN_OK)
        cn_mat3_tvec(rotation, d, out);
    else
        direction(lens, rotation, x + 0.5, y + 0.5, out);
}

/* The first sample goes through the pixel's middle and tells its depth; the others lie around it. */
static void expose_pixel(cn_film *film, const cn_exposure *e, uint32_t x, uint32_t y)
{
    const cn_lens_table *lens = e->lens;
    const size_t at = (size_t)y * lens->width + x;
    const uint64_t r = cn_rng_u64(e->world->options.seed, STREAM_PIXEL + 16 * (uint64_t)e->index, at);
    const double turn = 6.283185307179586 * (double)(r & 0xffff) * 0x1p-16;
    float clean[3] = { 0, 0, 0 }, seen[3] = { 0, 0, 0 }, still = 0;
    for (int s = 0; s < SAMPLES; s++) {
        const double a = turn + 6.283185307179586 * s / (SAMPLES - 1), reach = 0.38;
        cn_ray_query q = { .cone = 0.75f * lens->pixel };
        cn_ray_answer answer;
        /* The sun's disc in four parts, one a sample, so that soft shadows are even. */
        q.jitter[0] = fmodf((float)(r >> 16 & 0xffff) * 0x1p-16f + 0.618034f * (float)s, 1);
        q.jitter[1] = ((float)s + (float)(r >> 32 & 0xffff) * 0x1p-16f) / SAMPLES;
        memcpy(q.origin, e->shot->centre, sizeof q.origin);
        if (s == 0)
            middle(lens, e->shot->rotation, x, y, q.direction);
        else
            direction(lens, e->shot->rotation, x + 0.5 + reach * cos(a), y + 0.5 + reach * sin(a), q.direction);
        cn_world_look(e->world, e->run, e->crowd, &q, &answer);
        for (int c = 0; c < 3; c++) {
            clean[c] += answer.clean[c] / SAMPLES;
            seen[c] += answer.seen[c] / SAMPLES;
        }
        if (!answer.disturbed) still += 1.0f / SAMPLES;
        if (s == 0) film->distance_m[at] = (float)answer.distance_m;
    }
    memcpy(film->clean + 3 * at, clean, sizeof clean);
    memcpy(film->seen + 3 * at, seen, sizeof seen);
    film->still[at] = still;
}

void cn_film_expose(cn_film *film, const cn_exposure *exposure, uint32_t from, uint32_t to)
{
    for (uint32_t y = from; y < to; y++)
        for (uint32_t x = 0; x < exposure->lens->width; x++)
            expose_pixel(film, exposure, x, y);
}

cn_status cn_film_write_clean(const cn_film *film, uint32_t width, uint32_t height, const char *path)
{
    const size_t n = (size_t)width * height;
    float *rgba = malloc(n * 4 * sizeof *rgba);
    if (!rgba) return cn_fail(CN_ERR_NOMEM, "out of memory while writing %s", path);
    for (size_t i = 0; i < n; i++) {
        const float *rgb = film->clean + 3 * i;
        for (size_t c = 0; c < 3; c++) {
            const double *m = cn_acescg_from_srgb + 3 * c;
            rgba[4 * i + c] = (float)(m[0] * rgb[0] + m[1] * rgb[1] + m[2] * rgb[2]);
        }
        rgba[4 * i + 3] = 1;
    }
    const cn_status status = cn_oiio_write_exr(path, rgba, film->distance_m, width, height, NULL);
    free(rgba);
    return status;
}

cn_status cn_film_write_mask(const cn_film *film, uint32_t width, uint32_t height, const char *path)
{
    const size_t n = (size_t)width * height;
    float *rgb = malloc(n * 3 * sizeof *rgb);
    if (!rgb) return cn_fail(CN_ERR_NOMEM, "out of memory while writing %s", path);
    for (size_t i = 0; i < n; i++)
        rgb[3 * i] = rgb[3 * i + 1] = rgb[3 * i + 2] = film->still[i] > 0.999f ? 1 : 0;
    const cn_status status = cn_oiio_write_png(path, rgb, width, height, 3, NULL);
    free(rgb);
    return status;
}
