#include "splat/splat_file.h"

#include "base/file.h"

#include <math.h>
#include <string.h>

cn_status cn_splat_format_of(const char *path, cn_splat_format *format)
{
    const char *dot = strrchr(cn_path_base(path), '.');
    *format = dot && strcmp(dot, ".spz") == 0 ? CN_SPLAT_SPZ : CN_SPLAT_PLY;
    if (*format == CN_SPLAT_SPZ || (dot && strcmp(dot, ".ply") == 0)) return CN_OK;
    return cn_fail(CN_ERR_USAGE, "%s: a file of splats ends with .ply or .spz", path);
}

static bool finite_all(const float *values, size_t n)
{
    for (size_t i = 0; i < n; i++)
        if (!isfinite(values[i])) return false;
    return true;
}

static cn_status check(const cn_splats *s, const char *path)
{
    const size_t colours = s->n * (s->degree + 1) * (s->degree + 1) * 3;
    if (!s->n) return cn_fail(CN_ERR_DATA, "%s: there is no splat to write", path);
    bool fine = finite_all(s->centre[0], 3 * s->n) && finite_all(s->scale[0], 3 * s->n) &&
                finite_all(s->rotation[0], 4 * s->n) && finite_all(s->opacity, s->n) && finite_all(s->colour, colours);
    for (size_t i = 0; i < 3 * s->n && fine; i++)
        fine = s->scale[i / 3][i % 3] > 0;
    return fine ? CN_OK : cn_fail(CN_ERR_DATA, "%s: a splat has a number that is not finite, or a size of 0", path);
}

cn_status cn_splats_check_path(const char *path)
{
    cn_splat_format format;
    return cn_splat_format_of(path, &format);
}

cn_status cn_splats_write(const cn_splats *splats, const cn_splat_about *about, const char *path)
{
    cn_splat_format format;
    CN_TRY(cn_splat_format_of(path, &format));
    CN_TRY(check(splats, path));
    CN_TRY(cn_frame_save_beside(about->frame, path));
    return format == CN_SPLAT_SPZ ? cn_splat_spz_write(splats, about, path) : cn_splat_ply_write(splats, about, path);
}
