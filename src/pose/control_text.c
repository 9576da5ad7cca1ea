/* Control points in text files: the gcp_list.txt of ODM, and tables. */
#include "base/number.h"
#include "pose/control_file.h"
#include "pose/import_lines.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#define BLANKS " \t"

/* The first line, which names the coordinate system, perhaps as "crs,EPSG:25832" of a table. */
static cn_status read_crs(cn_control_file *file, const cn_import_lines *text)
{
    if (!text->n) return cn_import_lines_fault(text, 0, "a coordinate system");
    const char *line = text->lines[0];
    if (strncmp(line, "\xef\xbb\xbf", 3) == 0) line += 3;
    if (strncasecmp(line, "crs", 3) == 0) line += 3 + strspn(line + 3, " \t,;=:");
    const bool known =
        strncasecmp(line, "EPSG:", 5) == 0 || strncasecmp(line, "WGS84", 5) == 0 || strstr(line, "+proj");
    if (!known)
        return cn_fail(CN_ERR_FORMAT,
                       "%s: line %zu names no coordinate system; begin with a line such as EPSG:25832 or WGS84 UTM 32N",
                       text->path, text->numbers[0]);
    snprintf(file->crs, sizeof file->crs, "%.*s", (int)strcspn(line, ",;"), line);
    return CN_OK;
}

/* ---- gcp_list.txt ---- */

/* A number that may be NaN; the rest of the line begins at *at afterwards. */
static bool take_number(const char **at, double *value)
{
    char *end;
    *value = cn_parse_double(*at, &end);
    if (end == *at || isinf(*value)) return false;
    *at = end;
    return true;
}

/* A photo's name has no blanks there; what follows is the point's name. */
static cn_status read_entry(cn_control_file *file, const cn_import_lines *text, size_t i)
{
    static const char what[] = "x y z px py photo [name]";
    double v[5];
    char photo[1024], name[256], unnamed[80];
    const char *at = text->lines[i];
    for (int k = 0; k < 5; k++)
        if (!take_number(&at, &v[k])) return cn_import_lines_fault(text, i, what);
    if (isnan(v[0]) || isnan(v[1]) || isnan(v[3]) || isnan(v[4])) return cn_import_lines_fault(text, i, what);
    at += strspn(at, BLANKS);
    const int n_photo = (int)strcspn(at, BLANKS);
    if (!n_photo) return cn_import_lines_fault(text, i, what);
    snprintf(photo, sizeof photo, "%.*s", n_photo, at);
    at += n_photo;
    at += strspn(at, BLANKS);
    snprintf(name, sizeof name, "%.*s", (int)strcspn(at, BLANKS), at);
    /* Lines of one point without a name have the same place. */
    cn_print(unnamed, sizeof unnamed, "%.10g %.10g %.10g", v[0], v[1], v[2]);
    cn_control_seen seen = { .photo = photo, .x = v[3], .y = v[4] };
    CN_TRY(cn_control_file_point(file, *name ? name : unnamed, v, &seen.point));
    return cn_control_file_mark(file, &seen);
}

cn_status cn_control_read_list(cn_control_file *file)
{
    cn_import_lines text;
    CN_TRY(cn_import_lines_read(file->source->path, &text));
    cn_status status = read_crs(file, &text);
    for (size_t i = 1; i < text.n && status == CN_OK; i++)
        status = read_entry(file, &text, i);
    cn_import_lines_deinit(&text);
    return status;
}

/* ---- Tables ---- */

enum { NAME, X, Y, Z, PHOTO, PX, PY, SIGMA_XY, SIGMA_Z, CHECK, N_COLUMNS, MOST_CELLS = 64 };

static const char *const COLUMNS[N_COLUMNS][8] = {
    { "name", "label", "id", "point", "gcp" },
    { "x", "easting", "east", "lon", "longitude", "geo_x" },
    { "y", "northing", "north", "lat", "latitude", "geo_y" },
    { "z", "height", "elevation", "altitude", "alt", "geo_z" },
    { "photo", "image", "image_name", "file", "filename" },
    { "px", "im_x", "x_px", "pixel_x", "u" },
    { "py", "im_y", "y_px", "pixel_y", "v" },
    { "sigma_xy", "accuracy_xy", "sigma_h" },
    { "sigma_z", "accuracy_z", "sigma_v" },
    { "check", "is_check" },
};

typedef struct table {
    cn_control_file *file;
    const cn_import_lines *text;
    char separator;
    int column[N_COLUMNS]; /* -1: the table has none */
} table;

/* Splits a line in place; cells lose blanks and quotes at their ends. Returns how many. */
static int split(char *line, char separator, char *cells[MOST_CELLS])
{
    int n = 0;
    for (char *at = line; at && n < MOST_CELLS;) {
        char *next = strchr(at, separator), *end;
        if (next) *next = '\0';
        at += strspn(at, BLANKS "\"");
        for (end = at + strlen(at); end > at && strchr(BLANKS "\"", end[-1]);)
            *--end = '\0';
        cells[n++] = at;
        at = next ? next + 1 : NULL;
    }
    return n;
}

static int column_of(const char *name)
{
    for (int c = 0; c < N_COLUMNS; c++)
        for (int k = 0; k < 8 && COLUMNS[c][k]; k++)
            if (strcasecmp(COLUMNS[c][k], name) == 0) return c;
    return -1;
}

static cn_status read_head(table *t)
{
    char *cells[MOST_CELLS];
    if (t->text->n < 2) return cn_import_lines_fault(t->text, 1, "a line with the names of the columns");
    char *line = t->text->lines[1];
    t->separator = strchr(line, ';') ? ';' : strchr(line, ',') ? ',' : '\t';
    for (int c = 0; c < N_COLUMNS; c++)
        t->column[c] = -1;
    const int n = split(line, t->separator, cells);
    for (int i = 0; i < n; i++) {
        const int c = column_of(cells[i]);
        if (c >= 0 && t->column[c] < 0) t->column[c] = i;
    }
    for (int c = NAME; c <= PY; c++)
        if (t->column[c] < 0 && c != Z)
            return cn_fail(CN_ERR_FORMAT, "%s: line %zu names no column %s; wanted are name, x, y, z, photo, px, py",
                           t->text->path, t->text->numbers[1], COLUMNS[c][0]);
    return CN_OK;
}

typedef struct row {
    size_t line;
    char *cells[MOST_CELLS];
    int n;
} row;

static const char *cell(const table *t, const row *r, int c)
{
    return t->column[c] >= 0 && t->column[c] < r->n ? r->cells[t->column[c]] : "";
}

/* NaN where the cell is empty. */
static cn_status number(const table *t, const row *r, int c, double *value)
{
    const char *text = cell(t, r, c);
    char *end;
    *value = NAN;
    if (!*text) return CN_OK;
    *value = cn_parse_double(text, &end);
    if (*end || isinf(*value)) return cn_import_lines_fault(t->text, r->line, COLUMNS[c][0]);
    return CN_OK;
}

static cn_status take_sigma(const table *t, const row *r, cn_control_point *point)
{
    double across, up;
    CN_TRY(number(t, r, SIGMA_XY, &across));
    CN_TRY(number(t, r, SIGMA_Z, &up));
    if (across > 0) point->sigma_m[0] = point->sigma_m[1] = across;
    if (up > 0 || across > 0) point->sigma_m[2] = up > 0 ? up : across;
    if (up > 0 && !(across > 0)) point->sigma_m[0] = point->sigma_m[1] = up;
    const char *check = cell(t, r, CHECK);
    if (*check && strcmp(check, "0") != 0 && strcasecmp(check, "no") != 0 && strcasecmp(check, "false") != 0)
        point->check = true;
    return CN_OK;
}

static cn_status read_row(const table *t, size_t i)
{
    row r = { .line = i };
    double place[3], xy[2];
    r.n = split(t->text->lines[i], t->separator, r.cells);
    if (!*cell(t, &r, NAME)) return cn_import_lines_fault(t->text, i, "a point's name");
    for (int k = 0; k < 3; k++)
        CN_TRY(number(t, &r, X + k, &place[k]));
    if (isnan(place[0]) != isnan(place[1])) return cn_import_lines_fault(t->text, i, "both x and y");
    cn_control_seen seen = { .photo = cell(t, &r, PHOTO) };
    CN_TRY(cn_control_file_point(t->file, cell(t, &r, NAME), isnan(place[0]) ? NULL : place, &seen.point));
    CN_TRY(take_sigma(t, &r, &t->file->to->points[seen.point]));
    if (!*seen.photo) return CN_OK;
    for (int k = 0; k < 2; k++)
        CN_TRY(number(t, &r, PX + k, &xy[k]));
    if (isnan(xy[0]) || isnan(xy[1])) return cn_import_lines_fault(t->text, i, "px and py");
    seen.x = xy[0];
    seen.y = xy[1];
    return cn_control_file_mark(t->file, &seen);
}

cn_status cn_control_read_table(cn_control_file *file)
{
    cn_import_lines text;
    table t = { .file = file, .text = &text };
    CN_TRY(cn_import_lines_read(file->source->path, &text));
    cn_status status = read_crs(file, &text);
    if (status == CN_OK) status = read_head(&t);
    for (size_t i = 2; i < text.n && status == CN_OK; i++)
        status = read_row(&t, i);
    cn_import_lines_deinit(&text);
    return status;
}
