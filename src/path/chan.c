#include "base/file.h"
#include "base/number.h"
#include "base/units.h"
#include "path/camera.h"

#include <ctype.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { COLUMNS = 8, MOST_LINES = 1000000 };
#define MAX_BYTES (256u << 20)
#define DEFAULT_VFOV_DEG 60 /* of files without that column */

/* ---- rotation = Ry Rx Rz ---- */

static void angles_of(const double m[9], double deg[3])
{
    const double level = hypot(m[2], m[8]);
    deg[0] = cn_degrees(atan2(-m[5], level));
    if (level > 1e-9) {
        deg[1] = cn_degrees(atan2(m[2], m[8]));
        deg[2] = cn_degrees(atan2(m[3], m[4]));
    } else { /* straight up or down: y and z turn about the same line */
        deg[1] = cn_degrees(atan2(-m[6], m[0]));
        deg[2] = 0;
    }
}

static void rotation_of(const double deg[3], double m[9])
{
    double s[3], c[3];
    for (int k = 0; k < 3; k++) {
        s[k] = sin(cn_radians(deg[k]));
        c[k] = cos(cn_radians(deg[k]));
    }
    const double r[9] = { c[1] * c[2] + s[1] * s[0] * s[2],
                          s[1] * s[0] * c[2] - c[1] * s[2],
                          s[1] * c[0],
                          c[0] * s[2],
                          c[0] * c[2],
                          -s[0],
                          c[1] * s[0] * s[2] - s[1] * c[2],
                          s[1] * s[2] + c[1] * s[0] * c[2],
                          c[1] * c[0] };
    memcpy(m, r, sizeof r);
}

void cn_chan_write(FILE *stream, const cn_path *path)
{
    double before[3] = { 0 };
    for (uint32_t i = 0; i < path->n_frames; i++) {
        const cn_path_sample s = cn_path_sample_of(&path->frames[i]);
        double deg[3];
        angles_of(s.rotation, deg);
        for (int k = 0; k < 3; k++) {
            if (i) deg[k] += 360 * round((before[k] - deg[k]) / 360);
            before[k] = deg[k];
        }
        fprintf(stream, "%u\t%.9f\t%.9f\t%.9f\t%.9f\t%.9f\t%.9f\t%.9f\n", i, s.centre[0], s.centre[1], s.centre[2],
                deg[0], deg[1], deg[2], s.vfov_deg);
    }
}

/* ---- reading ---- */

/* The numbers of a line; how many there are, or -1 when there is something else. */
static int numbers_of(const char *line, double values[COLUMNS])
{
    int n = 0;
    for (;; n++) {
        while (*line == ' ' || *line == '\t' || *line == ',' || *line == '\r')
            line++;
        if (!*line || *line == '#') return n;
        char *end;
        const double value = n < COLUMNS ? cn_parse_double(line, &end) : NAN;
        if (!isfinite(value) || end == line) return -1;
        values[n] = value;
        line = end;
    }
}

static cn_status read_line(const char *where, const char *line, const cn_path_sample *before, cn_path_sample *sample,
                           bool *any)
{
    double v[COLUMNS] = { [7] = DEFAULT_VFOV_DEG };
    const int n = numbers_of(line, v);
    *any = n != 0;
    if (!n) return CN_OK;
    if (n != 7 && n != COLUMNS)
        return cn_fail(CN_ERR_FORMAT,
                       "%s: a camera's line has 8 numbers: frame, x y z, rotations about x y z, vertical field of view",
                       where);
    if (before && !(v[0] > before->time_s))
        return cn_fail(CN_ERR_FORMAT, "%s: frame %g is not later than %g; frames must increase", where, v[0],
                       before->time_s);
    if (!(v[7] >= 1 && v[7] <= 170))
        return cn_fail(CN_ERR_FORMAT, "%s: a field of view of %g degrees must lie between 1 and 170", where, v[7]);
    *sample = (cn_path_sample){ .time_s = v[0], .vfov_deg = v[7], .centre = { v[1], v[2], v[3] } };
    rotation_of(v + 4, sample->rotation);
    return CN_OK;
}

static cn_status read_lines(const char *file, char *text, cn_path_sample *samples, size_t *n)
{
    size_t number = 1;
    for (char *line = text, *next; line; line = next, number++) {
        char where[512];
        bool any;
        next = strchr(line, '\n');
        if (next) *next++ = '\0';
        snprintf(where, sizeof where, "%s: line %zu", file, number);
        CN_TRY(read_line(where, line, *n ? &samples[*n - 1] : NULL, &samples[*n], &any));
        *n += any;
    }
    return *n ? CN_OK : cn_fail(CN_ERR_FORMAT, "%s: no frame of a camera is in it", file);
}

cn_status cn_path_from_chan(cn_path *path, const char *file, const cn_path_options *options)
{
    char *text;
    size_t size, lines = 1, n = 0;
    const double fps = options->fps > 0 ? options->fps : 24;
    CN_TRY(cn_file_read(file, MAX_BYTES, &text, &size));
    for (const char *c = text; (c = strchr(c, '\n')); c++)
        lines++;
    cn_path_sample *samples = lines <= MOST_LINES + 1 ? calloc(lines + 1, sizeof *samples) : NULL;
    cn_status status =
        samples ? CN_OK : cn_fail(CN_ERR_FORMAT, "%s: %zu lines are too many; %d at most", file, lines, MOST_LINES);
    if (status == CN_OK) status = read_lines(file, text, samples, &n);
    for (size_t i = 0; i < n; i++) /* frames become seconds */
        samples[i].time_s /= fps;
    if (status == CN_OK) status = cn_path_from_samples(path, file, samples, n, fps, options);
    free(samples);
    free(text);
    return status;
}
