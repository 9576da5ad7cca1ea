/* Fills a scene with the photos of another tool's file. */
#include "pose/importer.h"

#include "base/file.h"
#include "math/linalg.h"
#include "pose/lens.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define NAMED_AT_MOST 5

cn_status cn_importer_room(cn_importer *to, size_t n)
{
    to->scene->views = calloc(n + 1, sizeof *to->scene->views);
    to->scene->cameras = calloc(n + 1, sizeof *to->scene->cameras);
    if (!to->scene->views || !to->scene->cameras || n > UINT32_MAX)
        return cn_fail(CN_ERR_NOMEM, "%s: out of memory for %zu photos", to->path, n);
    to->room = (uint32_t)n;
    return CN_OK;
}

/* file as a name of the index: relative to the photo folder when it is inside. */
static int64_t find_exact(const cn_importer *to, const char *file)
{
    const size_t n = strlen(to->index->folder);
    char *full = file[0] == '/' ? strdup(file) : cn_path_join(to->folder, file);
    int64_t found = -1;
    if (full && strncmp(full, to->index->folder, n) == 0 && full[n] == '/')
        found = cn_photo_finder_find(&to->finder, full + n + 1);
    free(full);
    return found < 0 ? cn_photo_finder_match(&to->finder, file) : found;
}

static int64_t find_with(const cn_importer *to, const char *name, const char *ending)
{
    char *named = cn_format("%s.%s", name, ending);
    const int64_t photo = named ? find_exact(to, named) : -1;
    free(named);
    return photo;
}

void cn_importer_find(cn_importer *to, const char *file, int64_t *photo)
{
    /* Where several photos differ in their endings alone, these go first. */
    static const char *const FIRST[] = { "png", "jpg", "jpeg", "PNG", "JPG", "JPEG" };
    const char *name = file, *ending;
    while (strncmp(name, "./", 2) == 0)
        name += 2;
    *photo = find_exact(to, name);
    for (size_t i = 0; i < sizeof FIRST / sizeof *FIRST && *photo < 0; i++)
        *photo = find_with(to, name, FIRST[i]);
    for (uint32_t i = 0; *photo < 0 && (ending = cn_photo_finder_ending(&to->finder, name, i)); i++)
        *photo = find_with(to, name, ending);
    to->n_frames++;
    if (*photo < 0 && to->n_missing++ < NAMED_AT_MOST)
        cn_log(to->ctx, CN_LOG_WARN, "%s: photo %s is not in the collection; left out", to->path, file);
}

cn_status cn_importer_add(cn_importer *to, int64_t photo, const cn_camera *camera, const cn_view *view)
{
    const char *name = to->index->photos[photo].name;
    if (to->scene->n_views >= to->room) return cn_fail(CN_ERR_INTERNAL, "%s: more photos than counted", to->path);
    for (int i = 0; i < 12; i++)
        if (!isfinite(i < 9 ? view->rotation[i] : view->translation[i - 9]))
            return cn_fail(CN_ERR_FORMAT, "%s: the pose of photo %s is not finite", to->path, name);
    cn_view *added = &to->scene->views[to->scene->n_views];
    *added = *view;
    added->photo = (uint32_t)photo;
    added->camera = to->scene->n_cameras;
    added->name = strdup(name);
    if (!added->name) return cn_fail(CN_ERR_NOMEM, "%s: out of memory", to->path);
    to->scene->cameras[to->scene->n_cameras] = *camera;
    to->scene->cameras[to->scene->n_cameras].id = to->scene->n_cameras + 1;
    to->scene->n_cameras++;
    to->scene->n_views++;
    return CN_OK;
}

cn_status cn_importer_sphere(cn_importer *to, const char *who, cn_camera *camera)
{
    if (camera->width != 2 * camera->height)
        return cn_fail(CN_ERR_FORMAT,
                       "%s: %s is a picture of all directions, %u x %u pixels, but such a picture is twice as "
                       "wide as high",
                       to->path, who, camera->width, camera->height);
    *camera = cn_camera_equirectangular(camera->width, camera->height);
    return CN_OK;
}

void cn_importer_who(const cn_photo *photo, char *who, size_t size)
{
    snprintf(who, size, "photo %s", photo->name);
}

/* The nearest rotation, by Newton's iteration R <- (R + R^-T) / 2. */
bool cn_import_rotation(double r[9])
{
    enum { ROUNDS = 8 };
    double rt[9], gram[9];
    cn_mat3_transpose(r, rt);
    cn_mat3_mul(rt, r, gram);
    for (int i = 0; i < 9; i++)
        if (!(fabs(gram[i] - (i % 4 == 0)) < 1e-2)) return false;
    for (int round = 0; round < ROUNDS; round++) {
        double cofactor[9];
        cn_cross3(r + 3, r + 6, cofactor);
        cn_cross3(r + 6, r, cofactor + 3);
        cn_cross3(r, r + 3, cofactor + 6);
        double determinant = cn_dot3(r, cofactor);
        if (!(determinant > 0.5)) return false; /* a mirror */
        for (int i = 0; i < 9; i++)
            r[i] = 0.5 * (r[i] + cofactor[i] / determinant);
    }
    return true;
}
