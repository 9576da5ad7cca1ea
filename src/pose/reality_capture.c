/* Reads "Internal/External camera parameters" of RealityCapture and RealityScan: a table with a line a photo, its
 * columns named in the first line. f, px and py are for a film 36 mm wide along the photo's longer side; px and py are
 * measured from the middle. With all angles 0 the camera looks down with its upper edge to the north (y); heading
 * turns it clockwise about z, then pitch about its x axis and roll about its y axis. k and t are Brown's model. Poses
 * are for the stored pixels. */
#include "base/file.h"
#include "base/number.h"
#include "base/units.h"
#include "math/linalg.h"
#include "pose/importer.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define FILM_MM 36.0
#define FAR_M 1e5 /* coordinates of a map, in which a float has too few digits */

enum column {
    NAME,
    X,
    Y,
    ALT,
    HEADING,
    PITCH,
    ROLL,
    F,
    N_NEEDED,
    PX = N_NEEDED,
    PY,
    K1,
    K2,
    K3,
    K4,
    T1,
    T2,
    N_COLUMNS
};
static const char *const COLUMNS[N_COLUMNS] = { "name", "x",  "y",  "alt", "heading", "pitch", "roll", "f",
                                                "px",   "py", "k1", "k2",  "k3",      "k4",    "t1",   "t2" };
enum { MOST_FIELDS = 64 };

typedef struct source {
    cn_importer *to;
    int fields[N_COLUMNS]; /* where a column stands in a line; -1: nowhere */
    size_t line;           /* from 1 */
    bool begun;
    double origin[2]; /* taken from x and y */
} source;

/* Cuts a line at its commas. */
static int split(char *line, char *fields[MOST_FIELDS])
{
    int n = 0;
    for (char *at = line; at && n < MOST_FIELDS; n++) {
        char *comma = strchr(at, ',');
        if (comma) *comma = '\0';
        at += strspn(at, " \t\"");
        for (size_t length = strlen(at); length && strchr(" \t\r\"", at[length - 1]); length--)
            at[length - 1] = '\0';
        fields[n] = at;
        at = comma ? comma + 1 : NULL;
    }
    return n;
}

static cn_status read_head(source *from, char *line)
{
    char *names[MOST_FIELDS];
    line += strspn(line, "# ");
    const int n = split(line, names);
    for (int c = 0; c < N_COLUMNS; c++) {
        from->fields[c] = -1;
        for (int i = 0; i < n; i++)
            if (strcmp(names[i], COLUMNS[c]) == 0) from->fields[c] = i;
        if (from->fields[c] < 0 && c < N_NEEDED)
            return cn_fail(CN_ERR_FORMAT,
                           "%s, line %zu: no column \"%s\"; export \"Internal/External camera parameters\"",
                           from->to->path, from->line, COLUMNS[c]);
    }
    return CN_OK;
}

static cn_status read_numbers(const source *from, char *const *fields, int n, double v[N_COLUMNS])
{
    for (int c = X; c < N_COLUMNS; c++) {
        char *end = NULL;
        v[c] = 0.0;
        if (from->fields[c] < 0) continue;
        const char *text = from->fields[c] < n ? fields[from->fields[c]] : "";
        v[c] = cn_parse_double(text, &end);
        if (end == text || *end || !isfinite(v[c]))
            return cn_fail(CN_ERR_FORMAT, "%s, line %zu: %s is \"%.40s\", not a number", from->to->path, from->line,
                           COLUMNS[c], text);
    }
    return CN_OK;
}

/* cam_from_world of OpenCV's camera, whose y and z point the other way than those of the angles' camera. */
static void rotation_of(const double v[N_COLUMNS], double r[9])
{
    const double h = -v[HEADING] * CN_PI / 180.0, p = v[PITCH] * CN_PI / 180.0, q = v[ROLL] * CN_PI / 180.0;
    const double about_z[9] = { cos(h), -sin(h), 0, sin(h), cos(h), 0, 0, 0, 1 };
    const double about_x[9] = { 1, 0, 0, 0, cos(p), -sin(p), 0, sin(p), cos(p) };
    const double about_y[9] = { cos(q), 0, sin(q), 0, 1, 0, -sin(q), 0, cos(q) };
    double turned[9], world[9];
    cn_mat3_mul(about_z, about_x, turned);
    cn_mat3_mul(turned, about_y, world);
    cn_mat3_transpose(world, r);
    for (int i = 3; i < 9; i++)
        r[i] = -r[i];
}

static cn_status make_camera(const source *from, const cn_photo *photo, const double *v, cn_camera *camera)
{
    char who[512];
    const bool turned = photo->orientation >= 5;
    *camera =
        (cn_camera){ .width = turned ? photo->height : photo->width, .height = turned ? photo->width : photo->height };
    const double longest = fmax(camera->width, camera->height), px = longest / FILM_MM;
    const cn_import_lens lens = { .fx = v[F] * px,
                                  .fy = v[F] * px,
                                  .cx = 0.5 * camera->width + v[PX] * px,
                                  .cy = 0.5 * camera->height + v[PY] * px,
                                  .k = { v[K1], v[K2], v[K3], v[K4] },
                                  .p = { v[T1], v[T2] } };
    cn_importer_who(photo, who, sizeof who);
    return cn_importer_lens(from->to, &lens, who, camera);
}

/* Coordinates of a map lose what they have in common: a round number of kilometres. */
static void choose_origin(source *from, const double *v)
{
    from->begun = true;
    for (int k = 0; k < 2; k++)
        from->origin[k] = fabs(v[X + k]) > FAR_M ? 1000.0 * round(v[X + k] / 1000.0) : 0.0;
    if (from->origin[0] != 0.0 || from->origin[1] != 0.0)
        cn_log(from->to->ctx, CN_LOG_INFO, "%s: its coordinates are of a map; %.0f, %.0f is taken from each",
               from->to->path, from->origin[0], from->origin[1]);
}

static cn_status check_degrees(const source *from, const cn_photo *photo, const double *v)
{
    if (!photo->has_gps || fabs(v[X] - photo->longitude_deg) > 0.01 || fabs(v[Y] - photo->latitude_deg) > 0.01)
        return CN_OK;
    return cn_fail(CN_ERR_FORMAT, "%s: x and y of photo %s are degrees; export in a coordinate system of metres",
                   from->to->path, photo->name);
}

static cn_status read_photo(source *from, char *line)
{
    char *fields[MOST_FIELDS];
    double v[N_COLUMNS];
    int64_t found;
    cn_view view = { 0 };
    cn_camera camera;
    const int n = split(line, fields);
    CN_TRY(read_numbers(from, fields, n, v));
    if (from->fields[NAME] >= n || !*fields[from->fields[NAME]])
        return cn_fail(CN_ERR_FORMAT, "%s, line %zu: the name of the photo is missing", from->to->path, from->line);
    cn_importer_find(from->to, fields[from->fields[NAME]], &found);
    if (found < 0) return CN_OK;
    const cn_photo *photo = &from->to->index->photos[found];
    CN_TRY(check_degrees(from, photo, v));
    if (!from->begun) choose_origin(from, v);
    const double centre[3] = { v[X] - from->origin[0], v[Y] - from->origin[1], v[ALT] };
    rotation_of(v, view.rotation);
    cn_mat3_vec(view.rotation, centre, view.translation);
    for (int k = 0; k < 3; k++)
        view.translation[k] = -view.translation[k];
    CN_TRY(make_camera(from, photo, v, &camera));
    return cn_importer_add(from->to, found, &camera, &view);
}

static size_t count_lines(const char *text)
{
    size_t n = 1;
    for (; *text; text++)
        n += *text == '\n';
    return n;
}

static cn_status read_table(source *from, char *text)
{
    bool headed = false;
    CN_TRY(cn_importer_room(from->to, count_lines(text)));
    for (char *line = text, *next; line; line = next) {
        next = strchr(line, '\n');
        if (next) *next++ = '\0';
        from->line++;
        if (strspn(line, " \t\r") == strlen(line) || strncmp(line, "#cameras", 8) == 0) continue;
        CN_TRY(headed ? read_photo(from, line) : read_head(from, line));
        headed = true;
    }
    return CN_OK;
}

cn_status cn_import_reality_capture(cn_importer *to)
{
    char *text = NULL;
    size_t size;
    source from = { .to = to };
    CN_TRY(cn_file_read(to->path, 0, &text, &size));
    const bool marked = size >= 3 && memcmp(text, "\xef\xbb\xbf", 3) == 0;
    const cn_status status = read_table(&from, text + (marked ? 3 : 0));
    free(text);
    return status;
}
