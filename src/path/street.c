/* A GeoJSON LineString as a camera path: along the street, at a height above the ground, looking ahead. */
#include "path/path.h"

#include "base/json.h"
#include "base/units.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define MAX_VERTICES 1000000u
#define MAX_DISTANCE_M 100e3 /* from the city: beyond this, coordinates are swapped or of another place */
#define MAX_SAMPLES 8000u

typedef struct street {
    const char *file;
    const cn_path_options *options;
    double height_m, speed_mps, fps, vfov_deg, pitch_deg;
    bool local;
    double (*vertex)[2];
    size_t n_vertices; /* local metres, no two neighbours alike */
    double length;
    double *line;
    size_t n;                /* samples, evenly along the vertices: x, y */
    double *smooth, *ground; /* the rounded line, and the camera's height below it */
    size_t reach;            /* samples that rounding reaches to either side */
} street;

/* The one LineString in a geometry, a feature or a collection; NULL with *count telling how many there were. */
static const json_t *find_line(const json_t *object, const json_t **properties, size_t *count)
{
    const char *type = json_string_value(json_object_get(object, "type"));
    const json_t *found = NULL;
    if (!type) return NULL;
    if (strcmp(type, "LineString") == 0) {
        ++*count;
        return object;
    }
    if (strcmp(type, "Feature") == 0) {
        found = find_line(json_object_get(object, "geometry"), properties, count);
        if (found) *properties = json_object_get(object, "properties");
        return found;
    }
    const json_t *list = json_object_get(object, strcmp(type, "FeatureCollection") == 0 ? "features" : "geometries");
    for (size_t i = 0; i < json_array_size(list); i++) {
        const json_t *here = find_line(json_array_get(list, i), properties, count);
        if (here) found = here;
    }
    return found;
}

static cn_status read_properties(street *s, const json_t *properties)
{
    const char *file = s->file;
    const json_t *p = json_is_object(properties) ? properties : NULL;
    *s = (street){ .file = file, .options = s->options, .height_m = 2, .speed_mps = 5, .fps = 24, .vfov_deg = 60 };
    if (s->options->fps > 0) s->fps = s->options->fps;
    if (p) {
        CN_TRY(cn_json_number_or(p, file, "height_m", s->height_m, &s->height_m));
        CN_TRY(cn_json_number_or(p, file, "speed_mps", s->speed_mps, &s->speed_mps));
        CN_TRY(cn_json_number_or(p, file, "fps", s->fps, &s->fps));
        CN_TRY(cn_json_number_or(p, file, "vfov_deg", s->vfov_deg, &s->vfov_deg));
        CN_TRY(cn_json_number_or(p, file, "pitch_deg", s->pitch_deg, &s->pitch_deg));
        if (json_object_get(p, "local")) CN_TRY(cn_json_bool(p, file, "local", &s->local));
    }
    if (!isnan(s->options->height_m)) s->height_m = s->options->height_m;
    if (!(s->speed_mps > 0)) return cn_fail(CN_ERR_FORMAT, "%s: \"speed_mps\" %g must be above 0", file, s->speed_mps);
    if (!(fabs(s->height_m) <= 1e5))
        return cn_fail(CN_ERR_FORMAT, "%s: \"height_m\" %g is out of range", file, s->height_m);
    if (!(s->vfov_deg >= 1 && s->vfov_deg <= 170))
        return cn_fail(CN_ERR_FORMAT, "%s: \"vfov_deg\" %g must lie between 1 and 170", file, s->vfov_deg);
    if (!(fabs(s->pitch_deg) <= 90))
        return cn_fail(CN_ERR_FORMAT, "%s: \"pitch_deg\" %g must lie between -90 and 90", file, s->pitch_deg);
    if (!s->local && !s->options->frame->georeferenced)
        return cn_fail(CN_ERR_FORMAT,
                       "%s: longitudes and latitudes need a georeferenced city, and this one has no GPS; give "
                       "coordinates in the units of the poses and the property \"local\": true",
                       file);
    return CN_OK;
}

static cn_status read_vertex(const street *s, size_t i, const json_t *vertex, double xy_m[2])
{
    const json_t *x = json_array_get(vertex, 0), *y = json_array_get(vertex, 1);
    if (!json_is_number(x) || !json_is_number(y))
        return cn_fail(CN_ERR_FORMAT, "%s: vertex %zu is not [longitude, latitude]", s->file, i);
    double at[3] = { json_number_value(y), json_number_value(x), s->options->frame->height_m },
           local[3] = { at[1], at[0], 0 };
    if (!s->local && (!(fabs(at[0]) <= 90) || !(fabs(at[1]) <= 360)))
        return cn_fail(CN_ERR_FORMAT,
                       "%s: vertex %zu: longitude %g, latitude %g is not on Earth; longitude comes first", s->file, i,
                       at[1], at[0]);
    if (!s->local) CN_TRY(cn_frame_from_geodetic(s->options->frame, at, local));
    memcpy(xy_m, local, sizeof(double[2]));
    double away = hypot(local[0], local[1]);
    if (!(away <= MAX_DISTANCE_M))
        return cn_fail(CN_ERR_FORMAT, "%s: vertex %zu is %.0f km from the city; [longitude, latitude] is the order",
                       s->file, i, away / 1000);
    return CN_OK;
}

static cn_status read_vertices(street *s, const json_t *line)
{
    const json_t *list;
    CN_TRY(cn_json_array(line, s->file, "coordinates", &list));
    size_t n = json_array_size(list);
    if (n < 2 || n > MAX_VERTICES)
        return cn_fail(CN_ERR_FORMAT, "%s: the LineString has %zu vertices; it must have 2 to %u", s->file, n,
                       MAX_VERTICES);
    s->vertex = malloc(n * sizeof *s->vertex);
    if (!s->vertex) return cn_fail(CN_ERR_NOMEM, "out of memory for the %zu vertices of %s", n, s->file);
    for (size_t i = 0; i < n; i++) {
        double *here = s->vertex[s->n_vertices];
        CN_TRY(read_vertex(s, i, json_array_get(list, i), here));
        double step = s->n_vertices ? hypot(here[0] - here[-2], here[1] - here[-1]) : INFINITY;
        if (!(step > 1e-6)) continue;
        if (s->n_vertices++) s->length += step;
    }
    return s->n_vertices > 1 ? CN_OK : cn_fail(CN_ERR_FORMAT, "%s: the LineString has no length", s->file);
}

/* Evenly spaced samples, corners rounded. */
static cn_status sample_line(street *s)
{
    /* A tenth of the height apart: finer than what is visible from that height. */
    double wanted = s->length / fmax(0.1 * fabs(s->height_m), 0.05);
    s->n = (size_t)fmin(fmax(ceil(wanted), 200), MAX_SAMPLES) + 1;
    s->line = malloc(5 * s->n * sizeof *s->line);
    if (!s->line) return cn_fail(CN_ERR_NOMEM, "out of memory for the street of %s", s->file);
    s->smooth = s->line + 2 * s->n;
    s->ground = s->smooth + 2 * s->n;
    double step = s->length / (double)(s->n - 1), passed = 0;
    size_t v = 0;
    for (size_t i = 0; i < s->n; i++) {
        double at = step * (double)i;
        const double *a = s->vertex[v], *b = s->vertex[v + 1];
        while (v + 2 < s->n_vertices && at > passed + hypot(b[0] - a[0], b[1] - a[1])) {
            passed += hypot(b[0] - a[0], b[1] - a[1]);
            v++;
            a = s->vertex[v];
            b = s->vertex[v + 1];
        }
        double t = fmin(fmax((at - passed) / hypot(b[0] - a[0], b[1] - a[1]), 0), 1);
        for (int c = 0; c < 2; c++)
            s->line[2 * i + (size_t)c] = a[c] + t * (b[c] - a[c]);
    }
    /* Corners are rounded over some metres: more for a higher camera, but never over most of the street. */
    s->reach = (size_t)fmax(1, fmin(4 + fabs(s->height_m) / 2, s->length / 10) / step);
    cn_path_smooth(s->n, 2, s->line, s->reach, s->smooth);
    return CN_OK;
}

/* The point of the line at sample `at`, also beyond its ends. */
static void point_at(const street *s, double at, double xy[2])
{
    double i = fmin(fmax(floor(at), 0), (double)s->n - 2), t = at - i;
    const double *p = s->smooth + 2 * (size_t)i;
    for (int c = 0; c < 2; c++)
        xy[c] = p[c] + t * (p[c + 2] - p[c]);
}

static cn_status place_frame(const street *s, cn_path *path, uint32_t f, double at)
{
    cn_path_shot shot = {
        .time_s = f / path->fps, .vfov_deg = s->vfov_deg, .width = s->options->width, .height = s->options->height
    };
    double ahead[2], behind[2], i = fmin(fmax(floor(at), 0), (double)s->n - 2);
    const double *z = s->ground + (size_t)i;
    point_at(s, at, shot.centre);
    point_at(s, at + (double)s->reach, ahead);
    point_at(s, at - (double)s->reach, behind);
    shot.centre[2] = z[0] + (at - i) * (z[1] - z[0]) + s->height_m;
    double heading = cn_degrees(atan2(ahead[0] - behind[0], ahead[1] - behind[1]));
    cn_path_angles(heading, s->pitch_deg, 0, shot.cam_from_world);
    return cn_path_place(path, f, &shot);
}

/* Frames at constant speed along the rounded line, which is shorter than the street. */
static cn_status walk(const street *s, cn_path *path)
{
    double length = 0, passed = 0;
    for (size_t i = 2; i < 2 * s->n; i += 2)
        length += hypot(s->smooth[i] - s->smooth[i - 2], s->smooth[i + 1] - s->smooth[i - 1]);
    CN_TRY(cn_path_start(path, s->file, length / s->speed_mps, s->fps, s->options));
    size_t k = 0;
    for (uint32_t f = 0; f < path->n_frames; f++) {
        double want = path->n_frames > 1 ? length * f / (path->n_frames - 1) : 0, gap;
        for (;; k++, passed += gap) {
            const double *p = s->smooth + 2 * k;
            gap = hypot(p[2] - p[0], p[3] - p[1]);
            if (want <= passed + gap || k + 2 >= s->n) break;
        }
        CN_TRY(place_frame(s, path, f, (double)k + (gap > 0 ? fmin((want - passed) / gap, 1) : 0)));
    }
    return CN_OK;
}

cn_status cn_path_from_geojson(cn_path *path, const char *file, const json_t *root, const cn_path_options *options)
{
    street s = { .file = file, .options = options };
    const json_t *properties = NULL;
    size_t count = 0;
    const json_t *line = find_line(root, &properties, &count);
    if (count != 1)
        return cn_fail(CN_ERR_FORMAT, "%s: a street is one LineString, but this GeoJSON has %zu", file, count);
    CN_TRY(read_properties(&s, properties));
    cn_status status = read_vertices(&s, line);
    if (status == CN_OK) status = sample_line(&s);
    if (status == CN_OK) status = cn_path_ground(options, file, s.n, (const double(*)[2])s.smooth, s.ground);
    if (status == CN_OK) status = cn_path_smooth_above(s.n, s.ground, s.reach);
    if (status == CN_OK) status = walk(&s, path);
    free(s.vertex);
    free(s.line);
    return status;
}
