/* A KML gx:Track as a camera path: when, gx:coord, gx:angles and altitudeMode. */
#include "path/path.h"

#include "base/date.h"
#include "base/file.h"
#include "base/number.h"
#include "base/units.h"
#include "math/linalg.h"

#include <expat.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define MAX_POINTS 1000000u
#define EYE_HEIGHT_M 2.0

typedef enum altitude_mode { CLAMP_TO_GROUND, RELATIVE_TO_GROUND, ABSOLUTE } altitude_mode;
typedef enum wanted { NOTHING, WHEN, COORD, ANGLES, MODE } wanted;

/* Rows of `width` numbers that grow. */
typedef struct column {
    double *values;
    size_t n, room;
    int width;
} column;

typedef struct track {
    const char *file;
    XML_Parser parser;
    cn_status status;
    altitude_mode mode;
    int n_tracks;
    bool inside; /* a track */
    wanted want; /* what the text is of the element that is open */
    char text[256];
    size_t length;
    column when, coord, angles;
} track;

static void refuse(track *t, cn_status status)
{
    t->status = status;
    XML_StopParser(t->parser, XML_FALSE);
}

static unsigned long line_of(const track *t)
{
    return (unsigned long)XML_GetCurrentLineNumber(t->parser);
}

static void append(track *t, column *c, const double *row)
{
    if (c->n == c->room) {
        size_t room = c->room ? 2 * c->room : 256;
        double *more = c->n < MAX_POINTS ? realloc(c->values, room * (size_t)c->width * sizeof *more) : NULL;
        if (!more) {
            refuse(t, cn_fail(CN_ERR_NOMEM, "%s: too many points in the track; %u at most", t->file, MAX_POINTS));
            return;
        }
        c->values = more;
        c->room = room;
    }
    memcpy(c->values + c->n++ * (size_t)c->width, row, (size_t)c->width * sizeof *row);
}

static int parse_numbers(const char *text, double *values, int most)
{
    int n = 0;
    for (char *end; n < most; n++, text = end) {
        values[n] = cn_parse_double(text, &end);
        if (end == text || !isfinite(values[n])) break;
    }
    return text[strspn(text, " \t\r\n")] ? -1 : n;
}

static void take_mode(track *t, const char *text)
{
    if (strcmp(text, "absolute") == 0)
        t->mode = ABSOLUTE;
    else if (strcmp(text, "relativeToGround") == 0)
        t->mode = RELATIVE_TO_GROUND;
    else if (strcmp(text, "clampToGround") == 0)
        t->mode = CLAMP_TO_GROUND;
    else
        refuse(t, cn_fail(CN_ERR_FORMAT,
                          "%s, line %lu: altitudeMode \"%.40s\"; give absolute, relativeToGround or clampToGround",
                          t->file, line_of(t), text));
}

static void take_text(track *t)
{
    char *text = t->text + strspn(t->text, " \t\r\n");
    for (size_t n = strlen(text); n && strchr(" \t\r\n", text[n - 1]); n--)
        text[n - 1] = 0;
    double v[3] = { 0 };
    if (t->want == WHEN) {
        v[0] = cn_parse_date_time(text);
        if (isnan(v[0]))
            refuse(t, cn_fail(CN_ERR_FORMAT,
                              "%s, line %lu: when \"%.40s\" is not a date and time like 2010-05-28T02:02:09Z", t->file,
                              line_of(t), text));
        else
            append(t, &t->when, v);
    } else if (t->want == COORD) {
        int n = parse_numbers(text, v, 3);
        if (n < 2 || fabs(v[0]) > 360 || fabs(v[1]) > 90)
            refuse(t, cn_fail(CN_ERR_FORMAT, "%s, line %lu: gx:coord \"%.60s\" is no \"longitude latitude altitude\"",
                              t->file, line_of(t), text));
        else
            append(t, &t->coord, v);
    } else if (t->want == ANGLES) {
        if (parse_numbers(text, v, 3) != 3)
            refuse(t, cn_fail(CN_ERR_FORMAT, "%s, line %lu: gx:angles \"%.60s\" is no \"heading tilt roll\"", t->file,
                              line_of(t), text));
        else
            append(t, &t->angles, v);
    } else if (t->want == MODE) {
        take_mode(t, text);
    }
}

static const char *local_name(const char *name)
{
    const char *colon = strchr(name, ':');
    return colon ? colon + 1 : name;
}

static void XMLCALL on_begin(void *user, const XML_Char *name, const XML_Char **attributes)
{
    track *t = user;
    (void)attributes;
    const char *local = local_name(name);
    if (strcmp(local, "Track") == 0) {
        t->inside = true;
        if (t->n_tracks++)
            refuse(t,
                   cn_fail(CN_ERR_FORMAT, "%s, line %lu: a second gx:Track; a path has only one", t->file, line_of(t)));
        return;
    }
    t->want = !t->inside                           ? NOTHING
              : strcmp(local, "when") == 0         ? WHEN
              : strcmp(local, "coord") == 0        ? COORD
              : strcmp(local, "angles") == 0       ? ANGLES
              : strcmp(local, "altitudeMode") == 0 ? MODE
                                                   : NOTHING;
    t->length = 0;
}

static void XMLCALL on_text(void *user, const XML_Char *text, int length)
{
    track *t = user;
    if (t->want == NOTHING) return;
    for (int i = 0; i < length && t->length + 1 < sizeof t->text; i++)
        t->text[t->length++] = text[i];
}

static void XMLCALL on_end(void *user, const XML_Char *name)
{
    track *t = user;
    if (strcmp(local_name(name), "Track") == 0) t->inside = false;
    if (t->want != NOTHING) {
        t->text[t->length] = 0;
        take_text(t);
    }
    t->want = NOTHING;
}

static cn_status parse(track *t, const char *data, size_t size)
{
    t->parser = XML_ParserCreate(NULL);
    if (!t->parser) return cn_fail(CN_ERR_NOMEM, "out of memory for %s", t->file);
    XML_SetUserData(t->parser, t);
    XML_SetElementHandler(t->parser, on_begin, on_end);
    XML_SetCharacterDataHandler(t->parser, on_text);
    if (XML_Parse(t->parser, data, (int)size, 1) != XML_STATUS_OK && t->status == CN_OK)
        t->status = cn_fail(CN_ERR_FORMAT, "%s, line %lu: not valid XML: %s", t->file, line_of(t),
                            XML_ErrorString(XML_GetErrorCode(t->parser)));
    XML_ParserFree(t->parser);
    CN_TRY(t->status);
    if (!t->n_tracks) return cn_fail(CN_ERR_FORMAT, "%s: there is no gx:Track in this KML", t->file);
    if (!t->coord.n) return cn_fail(CN_ERR_FORMAT, "%s: the gx:Track has no gx:coord", t->file);
    if (t->when.n != t->coord.n || (t->angles.n && t->angles.n != t->coord.n))
        return cn_fail(
            CN_ERR_FORMAT,
            "%s: the gx:Track has %zu when, %zu gx:coord and %zu gx:angles; give one of each per point (or no angles)",
            t->file, t->when.n, t->coord.n, t->angles.n);
    return CN_OK;
}

/* Positions, and times from the first point on. */
static cn_status place_keys(const track *t, const cn_path_options *options, cn_keyframe *keys)
{
    const cn_frame *frame = options->frame;
    for (size_t i = 0; i < t->coord.n; i++) {
        const double *c = t->coord.values + 3 * i;
        double place[3] = { c[1], c[0], t->mode == ABSOLUTE ? c[2] : frame->height_m }, undulation = 0;
        bool found;
        /* KML altitudes are above sea level; the frame's heights are above the ellipsoid only if the geoid was
         * applied. */
        if (t->mode == ABSOLUTE && frame->geoid_applied)
            CN_TRY(cn_geo_geoid_height(place[0], place[1], &undulation, &found));
        place[2] += undulation;
        CN_TRY(cn_frame_from_geodetic(frame, place, keys[i].position));
        keys[i].time_s = t->when.values[i] - t->when.values[0];
        keys[i].vfov_deg = 60;
        if (i && !(keys[i].time_s > keys[i - 1].time_s))
            return cn_fail(CN_ERR_FORMAT,
                           "%s: point %zu of the gx:Track is not later than the one before; times must increase",
                           t->file, i);
    }
    return CN_OK;
}

static cn_status raise_keys(const track *t, const cn_path_options *options, cn_keyframe *keys)
{
    size_t n = t->coord.n;
    if (t->mode == ABSOLUTE) return CN_OK;
    double(*xy)[2] = malloc(n * 3 * sizeof(double));
    if (!xy) return cn_fail(CN_ERR_NOMEM, "out of memory for the track of %s", t->file);
    double *ground = (double *)(xy + n);
    for (size_t i = 0; i < n; i++)
        memcpy(xy[i], keys[i].position, sizeof xy[i]);
    cn_status status = cn_path_ground(options, t->file, n, (const double(*)[2])xy, ground);
    double height = isnan(options->height_m) ? EYE_HEIGHT_M : options->height_m;
    for (size_t i = 0; i < n && status == CN_OK; i++)
        keys[i].position[2] = ground[i] + (t->mode == RELATIVE_TO_GROUND ? t->coord.values[3 * i + 2] : height);
    free(xy);
    return status;
}

/* The direction from gx:angles, or else along the track. */
static void turn_keys(const track *t, cn_keyframe *keys)
{
    size_t n = t->coord.n;
    double heading = 0;
    for (size_t i = 0; i < n; i++) {
        const double *a = t->angles.n ? t->angles.values + 3 * i : NULL;
        const double *from = keys[i ? i - 1 : 0].position, *to = keys[i + 1 < n ? i + 1 : i].position;
        double m[9], across = hypot(to[0] - from[0], to[1] - from[1]);
        if (across > 1e-6) heading = cn_degrees(atan2(to[0] - from[0], to[1] - from[1]));
        if (a)
            cn_path_angles(a[0], a[1], a[2], m);
        else
            cn_path_angles(heading, 0, 0, m);
        cn_mat3_to_quat(m, keys[i].quat);
    }
}

static cn_status fly(const track *t, cn_path *path, const cn_path_options *options)
{
    size_t n = t->coord.n;
    if (!options->frame->georeferenced)
        return cn_fail(CN_ERR_FORMAT,
                       "%s: a gx:Track needs a georeferenced city, and this one has no GPS; give JSON keyframes in "
                       "\"local\" coordinates",
                       t->file);
    cn_keyframe *keys = calloc(n, sizeof *keys);
    if (!keys) return cn_fail(CN_ERR_NOMEM, "out of memory for the track of %s", t->file);
    cn_status status = place_keys(t, options, keys);
    if (status == CN_OK) status = raise_keys(t, options, keys);
    if (status == CN_OK) turn_keys(t, keys);
    if (status == CN_OK)
        status = cn_path_start(path, t->file, keys[n - 1].time_s, options->fps > 0 ? options->fps : 24, options);
    if (status == CN_OK) status = cn_path_fly(path, keys, n, options->width, options->height);
    free(keys);
    return status;
}

cn_status cn_path_from_kml(cn_path *path, const char *file, const cn_path_options *options)
{
    track t = { .file = file, .when.width = 1, .coord.width = 3, .angles.width = 3 };
    char *data;
    size_t size;
    CN_TRY(cn_file_read(file, 256u << 20, &data, &size));
    cn_status status = parse(&t, data, size);
    if (status == CN_OK) status = fly(&t, path, options);
    free(data);
    free(t.when.values);
    free(t.coord.values);
    free(t.angles.values);
    return status;
}
