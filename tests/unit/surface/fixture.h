/* What tests of meshes and of splats share: views that look somewhere, and a folder for what is written. Include cmocka
 * first. */
#ifndef CONURB_TESTS_SURFACE_FIXTURE_H
#define CONURB_TESTS_SURFACE_FIXTURE_H
#include "base/file.h"
#include "conurb/surface.h"
#include "math/linalg.h"

#include <stdlib.h>

/* A view from a centre along z, a unit vector. */
static inline void view_along(cn_view *v, const double centre[3], const double z[3], const double up[3])
{
    double x[3], y[3];
    cn_cross3(z, up, x);
    (void)cn_normalize3(x);
    cn_cross3(z, x, y);
    *v = (cn_view){ .name = (char *)"view" };
    for (int k = 0; k < 3; k++) {
        v->rotation[k] = x[k];
        v->rotation[3 + k] = y[k];
        v->rotation[6 + k] = z[k];
    }
    cn_mat3_vec(v->rotation, centre, v->translation);
    for (int k = 0; k < 3; k++)
        v->translation[k] = -v->translation[k];
}

static inline cn_status export_to(const cn_context *ctx, const cn_surface_source *source, const char *folder,
                                  const char *name, cn_surface_report *report)
{
    char *path = cn_path_join(folder, name);
    const cn_status status = cn_surface_export(ctx, source, path, report);
    free(path);
    return status;
}

/* The caller frees *data. */
static inline void read_from(const char *folder, const char *name, char **data, size_t *size)
{
    char *path = cn_path_join(folder, name);
    assert_int_equal(cn_file_read(path, 0, data, size), CN_OK);
    free(path);
}

static inline void remove_folder(const char *folder)
{
    char *command = cn_format("rm -rf %s", folder);
    if (system(command) != 0) abort();
    free(command);
}
#endif
