/* Reads the PLY layout of Kerbl et al. 2023. */
#include "base/file.h"
#include "conurb/splat.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { MOST_PROPERTIES = 128, MOST_REST = 3 * 15, LINE = 256 };

/* What a file must have, then the harmonics, channel by channel. */
enum { AT_X, AT_DC = 3, AT_OPACITY = 6, AT_SCALE = 7, AT_ROT = 10, AT_REST = 14, AT_END = AT_REST + MOST_REST };
static const char *const wanted[AT_REST] = { "x",       "y",       "z",       "f_dc_0", "f_dc_1", "f_dc_2", "opacity",
                                             "scale_0", "scale_1", "scale_2", "rot_0",  "rot_1",  "rot_2",  "rot_3" };

typedef struct reader {
    const char *path, *at, *end;
    size_t n, n_properties;
    int column[AT_END]; /* of each of the above; -1: missing */
} reader;

static cn_status bad(const reader *r, const char *what)
{
    return cn_fail(CN_ERR_FORMAT, "%s: %s; give a PLY of Gaussians, as `conurb export --splats` writes it", r->path,
                   what);
}

static bool next_line(reader *r, char line[LINE])
{
    const char *end = memchr(r->at, '\n', (size_t)(r->end - r->at));
    if (!end || end - r->at >= LINE) return false;
    const size_t n = (size_t)(end - r->at);
    memcpy(line, r->at, n);
    line[n > 0 && line[n - 1] == '\r' ? n - 1 : n] = 0;
    r->at = end + 1;
    return true;
}

static void note_property(reader *r, const char *name)
{
    const int column = (int)r->n_properties++;
    for (int k = 0; k < AT_REST; k++)
        if (strcmp(name, wanted[k]) == 0) r->column[k] = column;
    if (strncmp(name, "f_rest_", 7) != 0) return;
    char *end;
    const unsigned long i = strtoul(name + 7, &end, 10);
    if (!*end && i < MOST_REST) r->column[AT_REST + i] = column;
}

static cn_status read_header(reader *r)
{
    char line[LINE];
    bool binary = false, vertices = false;
    if (!next_line(r, line) || strcmp(line, "ply") != 0) return bad(r, "its first line is not 'ply'");
    while (next_line(r, line) && strcmp(line, "end_header") != 0) {
        binary |= strcmp(line, "format binary_little_endian 1.0") == 0;
        if (strncmp(line, "element vertex ", 15) == 0) {
            r->n = strtoull(line + 15, NULL, 10);
            vertices = true;
        } else if (strncmp(line, "element ", 8) == 0)
            return bad(r, "it has something beside vertices");
        if (strncmp(line, "property ", 9) != 0) continue;
        if (strncmp(line, "property float ", 15) != 0 || r->n_properties == MOST_PROPERTIES)
            return bad(r, "a property is no float, or there are too many");
        note_property(r, line + 15);
    }
    if (!binary || !vertices || !r->n) return bad(r, "it is not binary little-endian, or has no vertex");
    for (int k = 0; k < AT_REST; k++)
        if (r->column[k] < 0) return cn_fail(CN_ERR_FORMAT, "%s: it lacks the property %s", r->path, wanted[k]);
    if (r->n > (size_t)(r->end - r->at) / (4 * r->n_properties)) return bad(r, "it is cut off");
    return CN_OK;
}

/* Of the spherical harmonics, as far as cn_splats goes; a file has one part of each channel after another. */
static uint32_t degree_of(const reader *r, size_t *per_channel)
{
    size_t rest = 0;
    while (rest < MOST_REST && r->column[AT_REST + rest] >= 0)
        rest++;
    *per_channel = rest / 3;
    return rest >= 24 ? 2 : rest >= 9 ? 1 : 0;
}

static bool fill_splat(cn_splats *s, size_t i, const reader *r, const float *row, size_t per_channel)
{
    const size_t n_c = (size_t)(s->degree + 1) * (s->degree + 1);
    float *colour = s->colour + i * n_c * 3, norm = 0;
    bool fine = true;
    for (int k = 0; k < 3; k++) {
        s->centre[i][k] = row[r->column[AT_X + k]];
        s->scale[i][k] = expf(row[r->column[AT_SCALE + k]]);
        colour[k] = row[r->column[AT_DC + k]];
        for (size_t c = 1; c < n_c; c++)
            colour[3 * c + (size_t)k] = row[r->column[AT_REST + (size_t)k * per_channel + c - 1]];
        fine = fine && isfinite(s->centre[i][k]) && isfinite(s->scale[i][k]) && s->scale[i][k] > 0;
    }
    for (int k = 0; k < 4; k++) {
        s->rotation[i][k] = row[r->column[AT_ROT + k]];
        norm += s->rotation[i][k] * s->rotation[i][k];
    }
    for (int k = 0; k < 4; k++)
        s->rotation[i][k] /= sqrtf(norm);
    s->opacity[i] = 1 / (1 + expf(-row[r->column[AT_OPACITY]]));
    for (size_t c = 0; c < 3 * n_c; c++)
        fine = fine && isfinite(colour[c]);
    return fine && isfinite(s->opacity[i]) && norm > 0 && isfinite(norm);
}

static cn_status read_rows(reader *r, cn_splats *s, size_t per_channel)
{
    float row[MOST_PROPERTIES];
    for (size_t i = 0; i < r->n; i++) {
        for (size_t k = 0; k < r->n_properties; k++, r->at += 4) {
            const uint8_t *b = (const uint8_t *)r->at;
            const uint32_t bits = b[0] | (uint32_t)b[1] << 8 | (uint32_t)b[2] << 16 | (uint32_t)b[3] << 24;
            memcpy(&row[k], &bits, sizeof bits);
        }
        if (!fill_splat(s, i, r, row, per_channel))
            return cn_fail(CN_ERR_FORMAT, "%s: Gaussian %zu has a number that is not finite, or no size", r->path, i);
    }
    return CN_OK;
}

cn_status cn_splats_read(cn_splats **splats, const char *path)
{
    char *data;
    size_t size, per_channel;
    *splats = NULL;
    CN_TRY(cn_file_read(path, (size_t)16 << 30, &data, &size));
    reader r = { .path = path, .at = data, .end = data + size };
    for (int k = 0; k < AT_END; k++)
        r.column[k] = -1;
    cn_status status = read_header(&r);
    if (status == CN_OK) {
        const uint32_t degree = degree_of(&r, &per_channel);
        status = cn_splats_create(splats, r.n, degree);
    }
    if (status == CN_OK) status = read_rows(&r, *splats, per_channel);
    if (status != CN_OK) cn_splats_destroy(splats);
    free(data);
    return status;
}
