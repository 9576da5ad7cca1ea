/* SPZ, version 2 (Niantic 2024): fixed-point attributes, one after another, compressed by gzip. Axes: x right, y up, z
 * backwards, here x east, y up, z south. */
#include "splat/splat_file.h"

#include "base/file.h"
#include "base/json.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <zlib.h>

enum { MAGIC = 0x5053474e, VERSION = 2, MOST_BITS = 12, HEADER = 16, BLOCK = 1 << 16 };
#define HALF 0.70710678f

typedef struct packing {
    const cn_splats *s;
    uint8_t *at;
    unsigned bits; /* of a place after the point */
} packing;

static uint8_t to_byte(float value)
{
    return (uint8_t)lrintf(fminf(fmaxf(value, 0), 255));
}

static void put_32(packing *p, uint32_t value)
{
    for (unsigned b = 0; b < 4; b++)
        *p->at++ = (uint8_t)(value >> (8 * b));
}

/* As many bits after the point as the farthest place leaves of 24, at most 12 (0.25 mm). */
static cn_status count_bits(packing *p, const char *path)
{
    double most = 0;
    for (size_t i = 0; i < p->s->n; i++)
        for (int k = 0; k < 3; k++)
            most = fmax(most, fabs(p->s->origin[k] + (double)p->s->centre[i][k]));
    for (p->bits = MOST_BITS; p->bits > 0 && ldexp(most, (int)p->bits) > 8388607; p->bits--) {
    }
    return ldexp(most, (int)p->bits) <= 8388607
               ? CN_OK
               : cn_fail(CN_ERR_DATA, "%s: a splat lies %g m from the origin, too far for SPZ; write a .ply", path,
                         most);
}

static void put_places(packing *p)
{
    for (size_t i = 0; i < p->s->n; i++) {
        double local[3];
        for (int k = 0; k < 3; k++)
            local[k] = p->s->origin[k] + (double)p->s->centre[i][k];
        const double turned[3] = { local[0], local[2], -local[1] };
        for (int k = 0; k < 3; k++) {
            const uint32_t fixed = (uint32_t)(int32_t)lrint(ldexp(turned[k], (int)p->bits));
            for (unsigned b = 0; b < 3; b++)
                *p->at++ = (uint8_t)(fixed >> (8 * b));
        }
    }
}

static void put_shapes(packing *p)
{
    const cn_splats *s = p->s;
    const size_t colours = (size_t)3 * (s->degree + 1) * (s->degree + 1);
    for (size_t i = 0; i < s->n; i++)
        *p->at++ = to_byte(255 * s->opacity[i]);
    for (size_t i = 0; i < s->n; i++)
        for (size_t k = 0; k < 3; k++)
            *p->at++ = to_byte(255 * (0.5f + 0.15f * s->colour[i * colours + k]));
    for (size_t i = 0; i < s->n; i++)
        for (int k = 0; k < 3; k++)
            *p->at++ = to_byte(16 * (logf(s->scale[i][k]) + 10));
    for (size_t i = 0; i < s->n; i++) {
        const float *q = s->rotation[i]; /* turned by -90 degrees about x */
        const float turned[4] = { HALF * (q[0] + q[1]), HALF * (q[1] - q[0]), HALF * (q[2] + q[3]),
                                  HALF * (q[3] - q[2]) };
        const float sign = turned[0] < 0 ? -1 : 1; /* w is not written, and is positive */
        for (int k = 1; k < 4; k++)
            *p->at++ = to_byte(127.5f + 127.5f * sign * turned[k]);
    }
}

/* The coefficients of degree 1 and 2 in the file's axes. */
static void turn_harmonics(const float *c, uint32_t degree, float *out)
{
    for (int k = 0; k < 3; k++) {
        out[3 + k] = -c[6 + k];
        out[6 + k] = c[3 + k];
        out[9 + k] = c[9 + k];
        if (degree < 2) continue;
        out[12 + k] = -c[21 + k];
        out[15 + k] = -c[15 + k];
        out[18 + k] = -0.5f * c[18 + k] - 0.8660254f * c[24 + k];
        out[21 + k] = c[12 + k];
        out[24 + k] = -0.8660254f * c[18 + k] + 0.5f * c[24 + k];
    }
}

static void put_harmonics(packing *p)
{
    const uint32_t degree = p->s->degree;
    const size_t colours = (size_t)3 * (degree + 1) * (degree + 1);
    for (size_t i = 0; i < p->s->n; i++) {
        float turned[27];
        if (degree) turn_harmonics(p->s->colour + i * colours, degree, turned);
        for (size_t k = 3; k < colours; k++) {
            const float step = k < 12 ? 8 : 16; /* 5 bits, then 4 bits */
            *p->at++ = to_byte(fminf(step * roundf((128 * turned[k] + 128) / step), 255));
        }
    }
}

static cn_status compress_to(FILE *stream, const uint8_t *data, size_t size, const char *path)
{
    z_stream z = { 0 };
    uint8_t out[BLOCK];
    int state = Z_OK;
    if (deflateInit2(&z, Z_DEFAULT_COMPRESSION, Z_DEFLATED, 15 + 16, 9, Z_DEFAULT_STRATEGY) != Z_OK)
        return cn_fail(CN_ERR_NOMEM, "out of memory to compress %s", path);
    for (size_t done = 0; state != Z_STREAM_END;) {
        if (!z.avail_in) {
            const size_t n = size - done < ((size_t)1 << 30) ? size - done : (size_t)1 << 30;
            z.next_in = (uint8_t *)(uintptr_t)(data + done);
            z.avail_in = (uInt)n;
            done += n;
        }
        z.next_out = out;
        z.avail_out = BLOCK;
        state = deflate(&z, done == size ? Z_FINISH : Z_NO_FLUSH);
        fwrite(out, 1, BLOCK - z.avail_out, stream);
    }
    deflateEnd(&z);
    return CN_OK;
}

/* What a PLY says in comments: F.about.json. */
static cn_status write_about(const cn_splats *s, const cn_splat_about *about, const char *path)
{
    const size_t stem = strlen(path) - strlen(".spz");
    char software[32];
    snprintf(software, sizeof software, "Conurb %s", cn_version());
    char *beside = cn_format("%.*s.about.json", (int)stem, path);
    json_t *root = json_pack("{s:s, s:s, s:s, s:s, s:I, s:i, s:b}", "software", software, "light",
                             about->light ? about->light : "", "tiles", about->tiles ? about->tiles : "", "axes",
                             "x east, y up, z south; metres from the origin of the frame", "splats", (json_int_t)s->n,
                             "degree", (int)s->degree, "georeferenced", (int)about->frame->georeferenced);
    const cn_status status =
        beside && root ? cn_json_save(root, beside) : cn_fail(CN_ERR_NOMEM, "out of memory for %s", path);
    json_decref(root);
    free(beside);
    return status;
}

cn_status cn_splat_spz_stream(const cn_splats *splats, FILE *stream, const char *path)
{
    const size_t harmonics = (size_t)3 * ((splats->degree + 1) * (splats->degree + 1) - 1);
    packing p = { .s = splats };
    if (splats->n > UINT32_MAX / 64) return cn_fail(CN_ERR_USAGE, "%s: %zu splats are too many", path, splats->n);
    CN_TRY(count_bits(&p, path));
    uint8_t *data = malloc(HEADER + splats->n * (9 + 1 + 3 + 3 + 3 + harmonics));
    if (!data) return cn_fail(CN_ERR_NOMEM, "out of memory for %s", path);
    p.at = data;
    put_32(&p, MAGIC);
    put_32(&p, VERSION);
    put_32(&p, (uint32_t)splats->n);
    put_32(&p, splats->degree | p.bits << 8);
    put_places(&p);
    put_shapes(&p);
    put_harmonics(&p);
    const cn_status status = compress_to(stream, data, (size_t)(p.at - data), path);
    free(data);
    return status;
}

cn_status cn_splat_spz_write(const cn_splats *splats, const cn_splat_about *about, const char *path)
{
    cn_writer writer;
    CN_TRY(cn_writer_open(&writer, path));
    cn_status status = cn_splat_spz_stream(splats, writer.stream, path);
    if (status == CN_OK) status = write_about(splats, about, path);
    if (status == CN_OK) status = cn_writer_commit(&writer);
    cn_writer_abort(&writer);
    return status;
}
