/* A file of coloured points: PLY in local metres, or LAS in the exports' coordinate system. */
#ifndef CONURB_EXPORT_POINT_FILE_H
#define CONURB_EXPORT_POINT_FILE_H
#include "base/file.h"
#include "export/about.h"
#include "export/projection.h"

typedef struct cn_point_file {
    cn_writer writer;
    const cn_survey *survey;
    bool las;
    uint64_t n;
    /* of a LAS file: */
    cn_projection projection;
    char *wkt;
    double scale, offset[3]; /* place = offset + scale * a 32-bit integer */
    int32_t low[3], high[3]; /* of the points */
} cn_point_file;

/* By the path's ending, .ply or .las. CN_ERR_USAGE: another one. */
CN_NODISCARD cn_status cn_point_file_kind(const char *path, bool *las);
/* spacing_m: between points. */
CN_NODISCARD cn_status cn_point_file_open(cn_point_file *file, const cn_survey *survey, const char *path,
                                          double spacing_m);
/* A local place, and its display-encoded colour. CN_ERR_DATA: the place is too far away for the format. */
CN_NODISCARD cn_status cn_point_file_add(cn_point_file *file, const double xyz[3], const float rgb[3]);
/* Writes the header and the frame beside the file, and puts the file in its place. */
CN_NODISCARD cn_status cn_point_file_finish(cn_point_file *file);
void cn_point_file_abort(cn_point_file *file); /* safe after finish, and when zeroed */

/* ---- las.c ---- */
/* LAS 1.4 R15 (ASPRS 2019), point format 7, not compressed: the coordinate system as WKT and a text about the file in
 * variable length records; 16-bit colours; a return of one; class 1, unclassified. No time is stored, and no date. */
CN_NODISCARD cn_status cn_las_begin(cn_point_file *file, double spacing_m);
void cn_las_write_header(cn_point_file *file); /* of the same length for every number of points */
CN_NODISCARD cn_status cn_las_write_point(cn_point_file *file, const double xyz[3], const uint8_t rgb[3]);
#endif
