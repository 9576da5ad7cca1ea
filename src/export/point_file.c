#include "export/point_file.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

cn_status cn_point_file_kind(const char *path, bool *las)
{
    const char *dot = strrchr(cn_path_base(path), '.');
    *las = dot && strcmp(dot, ".las") == 0;
    if (*las || (dot && strcmp(dot, ".ply") == 0)) return CN_OK;
    return cn_fail(CN_ERR_USAGE, "%s: a file of points ends with .ply or .las", path);
}

/* A header of the same length for every number of points, so that it can be written again at the end. */
static void write_ply_header(const cn_point_file *f)
{
    char count[24];
    cn_export_about about;
    cn_export_about_make(&about, f->survey);
    const int digits = snprintf(count, sizeof count, "%llu", (unsigned long long)f->n);
    fprintf(f->writer.stream,
            "ply\nformat binary_little_endian 1.0\ncomment %s: %s%*s\ncomment light: %s\ncomment tiles: %s\n"
            "element vertex %s\nproperty double x\nproperty double y\nproperty double z\nproperty uchar red\n"
            "property uchar green\nproperty uchar blue\nend_header\n",
            about.software,
            f->survey->frame->georeferenced ? "local metres, x east, y north, z up" : "axes and units of the poses",
            20 - digits, "", about.light, about.tiles, count);
}

static void write_ply_point(const cn_point_file *f, const double xyz[3], const uint8_t rgb[3])
{
    uint8_t row[27];
    for (int k = 0; k < 3; k++) {
        uint64_t bits;
        memcpy(&bits, &xyz[k], sizeof bits);
        for (int b = 0; b < 8; b++)
            row[8 * k + b] = (uint8_t)(bits >> (8 * b));
    }
    memcpy(row + 24, rgb, 3);
    fwrite(row, sizeof row, 1, f->writer.stream);
}

cn_status cn_point_file_open(cn_point_file *f, const cn_survey *survey, const char *path, double spacing_m)
{
    *f = (cn_point_file){ .survey = survey };
    CN_TRY(cn_point_file_kind(path, &f->las));
    CN_TRY(cn_writer_open(&f->writer, path));
    if (f->las) return cn_las_begin(f, spacing_m);
    write_ply_header(f);
    return CN_OK;
}

cn_status cn_point_file_add(cn_point_file *f, const double xyz[3], const float rgb[3])
{
    uint8_t bytes[3];
    for (int k = 0; k < 3; k++)
        bytes[k] = (uint8_t)lrintf(fminf(fmaxf(rgb[k], 0), 1) * 255);
    if (f->las)
        CN_TRY(cn_las_write_point(f, xyz, bytes));
    else
        write_ply_point(f, xyz, bytes);
    f->n++;
    return CN_OK;
}

cn_status cn_point_file_finish(cn_point_file *f)
{
    char *path = strdup(f->writer.path); /* commit frees it */
    if (!path) return cn_fail(CN_ERR_NOMEM, "out of memory");
    rewind(f->writer.stream);
    if (f->las)
        cn_las_write_header(f);
    else
        write_ply_header(f);
    cn_status status = cn_frame_save_beside(f->survey->frame, path);
    if (status == CN_OK) status = cn_writer_commit(&f->writer);
    free(path);
    return status;
}

void cn_point_file_abort(cn_point_file *f)
{
    cn_writer_abort(&f->writer);
    cn_projection_deinit(&f->projection);
    free(f->wkt);
    *f = (cn_point_file){ 0 };
}
