/* The PLY layout of Kerbl et al. 2023. */
#include "splat/splat_file.h"

#include "base/file.h"
#include "base/number.h"
#include "geo/heights.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

enum { MOST_FLOATS = 6 + 3 * 9 + 1 + 3 + 4 };

/* Files hold the logit of the opacity. It stays finite between 1e-6 and 1 - 1e-6. */
static float logit(float opacity)
{
    const float o = fminf(fmaxf(opacity, 1e-6f), 1 - 1e-6f);
    return logf(o / (1 - o));
}

/* A comment is one line, and a photo's name may hold anything. */
static void write_comment(FILE *stream, const char *what, const char *text)
{
    if (!text) return;
    fprintf(stream, "comment %s: ", what);
    for (; *text; text++)
        fputc((unsigned char)*text < ' ' ? ' ' : *text, stream);
    fputc('\n', stream);
}

static void write_header(FILE *stream, const cn_splats *s, const cn_splat_about *about)
{
    const cn_frame *f = about->frame;
    const unsigned rest = 3 * ((s->degree + 1) * (s->degree + 1) - 1);
    fprintf(stream, "ply\nformat binary_little_endian 1.0\ncomment Conurb %s: %s\n", cn_version(),
            f->georeferenced ? "local metres, x east, y north, z up" : "axes and units of the poses");
    write_comment(stream, "light", about->light);
    write_comment(stream, "tiles", about->tiles);
    if (f->georeferenced)
        fprintf(stream, "comment origin: %.9f %.9f %.4f (latitude, longitude, height %s)\n", f->latitude_deg,
                f->longitude_deg, f->height_m, cn_frame_heights(f));
    fprintf(stream, "element vertex %zu\n", s->n);
    static const char *const first[] = { "x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2" };
    static const char *const last[] = {
        "opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"
    };
    for (size_t i = 0; i < sizeof first / sizeof *first; i++)
        fprintf(stream, "property float %s\n", first[i]);
    for (unsigned i = 0; i < rest; i++)
        fprintf(stream, "property float f_rest_%u\n", i);
    for (size_t i = 0; i < sizeof last / sizeof *last; i++)
        fprintf(stream, "property float %s\n", last[i]);
    fputs("end_header\n", stream);
}

static size_t fill_row(const cn_splats *s, size_t i, float *row)
{
    const size_t n_c = (size_t)(s->degree + 1) * (s->degree + 1);
    const float *colour = s->colour + i * n_c * 3;
    size_t at = 0;
    for (int k = 0; k < 3; k++)
        row[at++] = (float)(s->origin[k] + (double)s->centre[i][k]);
    for (int k = 0; k < 3; k++)
        row[at++] = 0; /* normals, which no viewer reads */
    for (int k = 0; k < 3; k++)
        row[at++] = colour[k];
    for (size_t k = 0; k < 3; k++) /* channel by channel */
        for (size_t c = 1; c < n_c; c++)
            row[at++] = colour[3 * c + k];
    row[at++] = logit(s->opacity[i]);
    for (int k = 0; k < 3; k++)
        row[at++] = logf(s->scale[i][k]);
    for (int k = 0; k < 4; k++)
        row[at++] = s->rotation[i][k];
    return at;
}

static void write_rows(FILE *stream, const cn_splats *s)
{
    float row[MOST_FLOATS];
    uint8_t bytes[4 * MOST_FLOATS];
    for (size_t i = 0; i < s->n; i++) {
        const size_t n = fill_row(s, i, row);
        for (size_t k = 0; k < n; k++) {
            uint32_t bits;
            memcpy(&bits, &row[k], sizeof bits);
            for (unsigned b = 0; b < 4; b++)
                bytes[4 * k + b] = (uint8_t)(bits >> (8 * b));
        }
        fwrite(bytes, 4, n, stream);
    }
}

cn_status cn_splat_ply_write(const cn_splats *splats, const cn_splat_about *about, const char *path)
{
    cn_writer writer;
    CN_TRY(cn_writer_open(&writer, path));
    const locale_t before = cn_number_begin();
    write_header(writer.stream, splats, about);
    cn_number_end(before);
    write_rows(writer.stream, splats);
    return cn_writer_commit(&writer);
}
