/* Reads the .nvm files of VisualSfM (Wu 2013, "Towards linear-time incremental structure from motion"), which MVE and
 * COLMAP write too. A line a photo: name, focal length in pixels, rotation and centre of the camera, and a radial term
 * that takes distorted places to undistorted ones. Poses are for the stored pixels. */
#include "math/linalg.h"
#include "pose/import_lines.h"
#include "pose/importer.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { NUMBERS = 10, FOCAL = 0, QUATERNION = 1, CENTRE = 5, RADIAL = 8 };

typedef struct source {
    cn_importer *to;
    cn_import_lines text;
    bool fixed;      /* one calibration for all photos */
    double known[5]; /* then: fx cx fy cy radial */
} source;

/* "NVM_V3", and perhaps "FixedK fx cx fy cy radial". */
static cn_status read_head(source *from)
{
    static const char NAME[] = "NVM_V3", FIXED[] = "FixedK";
    const char *at = from->text.n ? from->text.lines[0] : "";
    if (strncmp(at, NAME, sizeof NAME - 1) != 0) return cn_import_lines_fault(&from->text, 0, "NVM_V3");
    at += sizeof NAME - 1;
    at += strspn(at, " \t");
    if (strncmp(at, FIXED, sizeof FIXED - 1) != 0) return CN_OK;
    from->fixed = true;
    const cn_import_numbers numbers = { at + sizeof FIXED - 1, "fx, cx, fy, cy and a radial term after FixedK",
                                        from->known, 5 };
    return cn_import_lines_numbers(&from->text, 0, &numbers);
}

/* The name may have blanks, so the numbers are found from the end. VisualSfM writes " for a blank. The line is cut
 * after the name. */
static const char *split_name(char *line)
{
    char *at = line + strlen(line);
    for (int k = 0; k < NUMBERS; k++) {
        while (at > line && strchr(" \t", at[-1]))
            at--;
        while (at > line && !strchr(" \t", at[-1]))
            at--;
    }
    if (at == line) return NULL;
    at[-1] = '\0';
    for (char *c = line; *c; c++)
        if (*c == '"') *c = ' ';
    return at;
}

static cn_status make_camera(const source *from, const cn_photo *photo, const double *v, cn_camera *camera)
{
    char who[512];
    const bool turned = photo->orientation >= 5;
    *camera =
        (cn_camera){ .width = turned ? photo->height : photo->width, .height = turned ? photo->width : photo->height };
    cn_import_lens lens = { .undistorts = true, .fx = v[FOCAL], .fy = v[FOCAL], .k = { v[RADIAL] } };
    lens.cx = 0.5 * camera->width;
    lens.cy = 0.5 * camera->height;
    if (from->fixed) {
        lens.fx = from->known[0];
        lens.cx = from->known[1];
        lens.fy = from->known[2];
        lens.cy = from->known[3];
        lens.k[0] = from->known[4];
    }
    cn_importer_who(photo, who, sizeof who);
    return cn_importer_lens(from->to, &lens, who, camera);
}

static cn_status read_photo(source *from, size_t i)
{
    double v[NUMBERS];
    int64_t photo;
    cn_view view = { 0 };
    cn_camera camera;
    char *line = from->text.lines[i];
    const char *numbers = split_name(line), *const what = "a name and 10 numbers of a photo";
    if (!numbers) return cn_import_lines_fault(&from->text, i, what);
    CN_TRY(cn_import_lines_numbers(&from->text, i, &(cn_import_numbers){ numbers, what, v, NUMBERS }));
    cn_importer_find(from->to, line, &photo);
    if (photo < 0) return CN_OK;
    const double *q = v + QUATERNION, length = sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
    if (!(fabs(length - 1.0) < 1e-2)) return cn_import_lines_fault(&from->text, i, "a rotation of length 1");
    const double unit[4] = { q[0] / length, q[1] / length, q[2] / length, q[3] / length };
    cn_quat_to_mat3(unit, view.rotation);
    cn_mat3_vec(view.rotation, v + CENTRE, view.translation);
    for (int k = 0; k < 3; k++)
        view.translation[k] = -view.translation[k];
    CN_TRY(make_camera(from, &from->to->index->photos[photo], v, &camera));
    return cn_importer_add(from->to, photo, &camera, &view);
}

/* The model with the most photos: *first is its first photo's line. Each model is a count of photos, their lines, a
 * count of points, and their lines; a count of 0 ends the list. */
static cn_status find_model(const source *from, size_t *first, size_t *n)
{
    const cn_import_lines *text = &from->text;
    from->to->n_models = 0;
    *n = 0;
    for (size_t at = 1; at < text->n;) {
        size_t n_photos, n_points;
        CN_TRY(cn_import_lines_count(text, at, "the number of photos", &n_photos));
        if (!n_photos) break;
        if (n_photos > *n) {
            *n = n_photos;
            *first = at + 1;
        }
        at += 1 + n_photos;
        CN_TRY(cn_import_lines_count(text, at, "the number of points", &n_points));
        at += 1 + n_points;
        from->to->n_models++;
    }
    return *n ? CN_OK : cn_fail(CN_ERR_FORMAT, "%s: it has no model with photos; export it again", text->path);
}

static cn_status read_model(source *from)
{
    size_t first = 0, n;
    CN_TRY(read_head(from));
    CN_TRY(find_model(from, &first, &n));
    CN_TRY(cn_importer_room(from->to, n));
    for (size_t i = 0; i < n; i++)
        CN_TRY(read_photo(from, first + i));
    return CN_OK;
}

cn_status cn_import_nvm(cn_importer *to)
{
    source from = { .to = to };
    CN_TRY(cn_import_lines_read(to->path, &from.text));
    const cn_status status = read_model(&from);
    cn_import_lines_deinit(&from.text);
    return status;
}
