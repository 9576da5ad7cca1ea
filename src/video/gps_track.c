#include "video/gps_track.h"

#include "base/date.h"
#include "base/file.h"
#include "base/number.h"

#include <expat.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define MOST_POINTS 10000000u
#define MOST_BYTES (256u << 20)
#define GAP_S 10.0
#define BEYOND_S 1.0

void cn_gps_track_deinit(cn_gps_track *track)
{
    free(track->points);
    *track = (cn_gps_track){ 0 };
}

cn_status cn_gps_track_add(cn_gps_track *track, const cn_gps_point *point)
{
    if (point->latitude_deg == 0 && point->longitude_deg == 0) return CN_OK;
    if (track->n == track->room) {
        const size_t room = track->room ? 2 * track->room : 256;
        cn_gps_point *more = track->n < MOST_POINTS ? realloc(track->points, room * sizeof *more) : NULL;
        if (!more) return cn_fail(CN_ERR_NOMEM, "too many points in a track of GPS; %u at most", MOST_POINTS);
        track->points = more;
        track->room = room;
    }
    track->points[track->n++] = *point;
    return CN_OK;
}

static int by_time(const void *a, const void *b)
{
    const cn_gps_point *p = a, *q = b;
    if (p->time_s != q->time_s) return p->time_s < q->time_s ? -1 : 1;
    if (p->latitude_deg != q->latitude_deg) return p->latitude_deg < q->latitude_deg ? -1 : 1;
    return (p->longitude_deg > q->longitude_deg) - (p->longitude_deg < q->longitude_deg);
}

void cn_gps_track_sort(cn_gps_track *track)
{
    bool sorted = true;
    for (size_t i = 1; i < track->n && sorted; i++)
        sorted = track->points[i - 1].time_s <= track->points[i].time_s;
    if (!sorted) qsort(track->points, track->n, sizeof *track->points, by_time);
    size_t n = 0;
    for (size_t i = 0; i < track->n; i++)
        if (!n || track->points[i].time_s > track->points[n - 1].time_s) track->points[n++] = track->points[i];
    track->n = n;
}

bool cn_gps_track_at(const cn_gps_track *track, double time_s, cn_gps_point *at)
{
    if (!track->n) return false;
    size_t low = 0, high = track->n; /* points before `low` are not later than time_s */
    while (low < high) {
        const size_t mid = low + (high - low) / 2;
        if (track->points[mid].time_s <= time_s)
            low = mid + 1;
        else
            high = mid;
    }
    const cn_gps_point *before = low ? &track->points[low - 1] : NULL;
    const cn_gps_point *after = low < track->n ? &track->points[low] : NULL;
    if (!before || !after) {
        *at = before ? *before : *after;
        return fabs(at->time_s - time_s) <= BEYOND_S;
    }
    if (after->time_s - before->time_s > GAP_S) { /* no straight line over so long a gap, but near its ends a place */
        *at = time_s - before->time_s <= after->time_s - time_s ? *before : *after;
        return fabs(at->time_s - time_s) <= BEYOND_S;
    }
    const double t = (time_s - before->time_s) / (after->time_s - before->time_s);
    const double east = remainder(after->longitude_deg - before->longitude_deg, 360.0);
    *at = (cn_gps_point){ .time_s = time_s,
                          .latitude_deg = before->latitude_deg + t * (after->latitude_deg - before->latitude_deg),
                          .longitude_deg = remainder(before->longitude_deg + t * east, 360.0),
                          .altitude_m = before->altitude_m + t * (after->altitude_m - before->altitude_m) };
    return true;
}

/* ---- GPX: trkpt with lat, lon, ele and time. KML: gx:Track with when and gx:coord, in equal numbers. ---- */
typedef enum wanted { NOTHING, ELE, TIME, WHEN, COORD } wanted;

typedef struct reader {
    const char *path;
    XML_Parser parser;
    cn_gps_track *track;
    cn_status status;
    bool in_point, in_track;
    cn_gps_point point;
    size_t n_when, n_coord; /* KML: both lists fill the same points */
    wanted want;
    char text[128];
    size_t length;
} reader;

static void refuse(reader *r, cn_status status)
{
    if (r->status == CN_OK) r->status = status;
    XML_StopParser(r->parser, XML_FALSE);
}

static void complain(reader *r, const char *what, const char *text)
{
    refuse(r, cn_fail(CN_ERR_FORMAT, "%s, line %lu: %s \"%.60s\"", r->path,
                      (unsigned long)XML_GetCurrentLineNumber(r->parser), what, text));
}

static bool is_place(const cn_gps_point *p)
{
    return fabs(p->latitude_deg) <= 90 && fabs(p->longitude_deg) <= 360;
}

static const char *local_name(const char *name)
{
    const char *colon = strchr(name, ':');
    return colon ? colon + 1 : name;
}

static void XMLCALL on_begin(void *user, const XML_Char *name, const XML_Char **attributes)
{
    reader *r = user;
    const char *local = local_name(name);
    if (strcmp(local, "trkpt") == 0) {
        r->in_point = true;
        r->point = (cn_gps_point){ NAN, NAN, NAN, NAN };
        for (; attributes[0]; attributes += 2) {
            if (strcmp(attributes[0], "lat") == 0) r->point.latitude_deg = cn_parse_double(attributes[1], NULL);
            if (strcmp(attributes[0], "lon") == 0) r->point.longitude_deg = cn_parse_double(attributes[1], NULL);
        }
        if (!is_place(&r->point)) complain(r, "a trkpt has no lat and lon on Earth", "");
    }
    if (strcmp(local, "Track") == 0) r->in_track = true;
    r->want = r->in_point && strcmp(local, "ele") == 0     ? ELE
              : r->in_point && strcmp(local, "time") == 0  ? TIME
              : r->in_track && strcmp(local, "when") == 0  ? WHEN
              : r->in_track && strcmp(local, "coord") == 0 ? COORD
                                                           : NOTHING;
    r->length = 0;
}

static void XMLCALL on_text(void *user, const XML_Char *text, int length)
{
    reader *r = user;
    for (int i = 0; r->want != NOTHING && i < length && r->length + 1 < sizeof r->text; i++)
        r->text[r->length++] = text[i];
}

/* KML lists all times, then all places: the one that comes first makes the points. */
static cn_gps_point *kml_point(reader *r, size_t i)
{
    if (i < r->track->n) return &r->track->points[i];
    const cn_status status = cn_gps_track_add(r->track, &(cn_gps_point){ NAN, NAN, NAN, NAN });
    if (status == CN_OK) return &r->track->points[i];
    refuse(r, status);
    return NULL;
}

static void take_coord(reader *r, const char *text)
{
    double v[3] = { NAN, NAN, NAN };
    int n = 0;
    for (char *end; n < 3; n++, text = end) {
        v[n] = cn_parse_double(text, &end);
        if (end == text) break;
    }
    cn_gps_point *p = kml_point(r, r->n_coord++);
    if (!p) return;
    p->longitude_deg = v[0];
    p->latitude_deg = v[1];
    p->altitude_m = n == 3 ? v[2] : NAN;
    if (n < 2 || !is_place(p)) complain(r, "no \"longitude latitude altitude\" on Earth in gx:coord", r->text);
}

static void take_time(reader *r, const char *text, double *out)
{
    *out = cn_parse_date_time(text);
    if (isnan(*out)) complain(r, "not a date and time like 2010-05-28T02:02:09Z:", text);
}

static void XMLCALL on_end(void *user, const XML_Char *name)
{
    reader *r = user;
    const char *local = local_name(name);
    r->text[r->length] = '\0';
    const char *text = r->text + strspn(r->text, " \t\r\n");
    for (; r->length && strchr(" \t\r\n", r->text[r->length - 1]); r->length--)
        r->text[r->length - 1] = '\0';
    const wanted want = r->want;
    r->want = NOTHING;
    if (want == ELE) r->point.altitude_m = cn_parse_double(text, NULL);
    if (want == TIME) take_time(r, text, &r->point.time_s);
    if (want == COORD) take_coord(r, text);
    if (want == WHEN) {
        cn_gps_point *p = kml_point(r, r->n_when++);
        if (p) take_time(r, text, &p->time_s);
    }
    if (strcmp(local, "trkpt") == 0) {
        r->in_point = false;
        if (isnan(r->point.time_s))
            complain(r, "a trkpt has no time", "");
        else if (cn_gps_track_add(r->track, &r->point) != CN_OK)
            refuse(r, CN_ERR_NOMEM);
    }
    if (strcmp(local, "Track") == 0) r->in_track = false;
}

static cn_status read_xml(cn_gps_track *track, const char *path, const char *text, size_t size)
{
    reader r = { .path = path, .track = track, .parser = XML_ParserCreate(NULL) };
    if (!r.parser) return cn_fail(CN_ERR_NOMEM, "%s: out of memory", path);
    XML_SetUserData(r.parser, &r);
    XML_SetElementHandler(r.parser, on_begin, on_end);
    XML_SetCharacterDataHandler(r.parser, on_text);
    if (XML_Parse(r.parser, text, (int)size, 1) != XML_STATUS_OK && r.status == CN_OK)
        r.status =
            cn_fail(CN_ERR_FORMAT, "%s, line %lu: not valid XML: %s", path,
                    (unsigned long)XML_GetCurrentLineNumber(r.parser), XML_ErrorString(XML_GetErrorCode(r.parser)));
    XML_ParserFree(r.parser);
    if (r.status == CN_OK && r.n_when != r.n_coord)
        return cn_fail(CN_ERR_FORMAT, "%s: its gx:Track has %zu when and %zu gx:coord; give one of each per point",
                       path, r.n_when, r.n_coord);
    return r.status;
}

/* ---- SRT: "00:00:01,033 --> ..." and a text with the place at that time of the video. ---- */

/* The number after `name` and a colon, blank or bracket; NaN without. */
static double number_after(const char *text, const char *name)
{
    const char *at = strstr(text, name);
    if (!at) return NAN;
    char *end;
    at += strlen(name);
    at += strspn(at, " :\t");
    const double value = cn_parse_double(at, &end);
    return end == at ? NAN : value;
}

/* Newer drones: [latitude: 46.1] [longitude: 8.1] [rel_alt: 1.3 abs_alt: 512.3], of which some write longtitude and
 * altitude. Older ones: GPS(8.1,46.1,20), longitude first; the third number counts satellites. */
static bool parse_place(const char *text, cn_gps_point *p)
{
    p->altitude_m = NAN;
    p->latitude_deg = number_after(text, "latitude");
    p->longitude_deg = number_after(text, "longitude");
    if (isnan(p->longitude_deg)) p->longitude_deg = number_after(text, "longtitude");
    if (!isnan(p->latitude_deg) && !isnan(p->longitude_deg)) {
        p->altitude_m = number_after(text, "abs_alt");
        if (isnan(p->altitude_m)) p->altitude_m = number_after(text, "[altitude");
        return is_place(p);
    }
    const char *at = strstr(text, "GPS");
    if (!at) return false;
    at += 3 + strspn(at + 3, " ");
    if (*at++ != '(') return false;
    char *end;
    p->longitude_deg = cn_parse_double(at, &end);
    if (*end != ',') return false;
    p->latitude_deg = cn_parse_double(end + 1, &end);
    return *end == ',' && is_place(p);
}

static cn_status read_srt(cn_gps_track *track, char *text)
{
    track->from_start = true;
    for (char *arrow = strstr(text, "-->"); arrow;) {
        char *next = strstr(arrow + 3, "-->");
        int hour, minute, second, part;
        cn_gps_point p;
        char *line = arrow;
        while (line > text && line[-1] != '\n')
            line--;
        if (next) *next = '\0';
        if (sscanf(line, "%d:%d:%d%*[,.]%3d", &hour, &minute, &second, &part) == 4 && parse_place(arrow, &p)) {
            p.time_s = 3600.0 * hour + 60.0 * minute + second + 0.001 * part;
            CN_TRY(cn_gps_track_add(track, &p));
        }
        if (next) *next = '-';
        arrow = next;
    }
    return CN_OK;
}

static cn_status read_text(cn_gps_track *track, const char *path, char *text, size_t size)
{
    const char *at = text + (size >= 3 && memcmp(text, "\xef\xbb\xbf", 3) == 0 ? 3 : 0);
    at += strspn(at, " \t\r\n");
    if (*at == '<')
        CN_TRY(read_xml(track, path, text, size));
    else if (strstr(text, "-->"))
        CN_TRY(read_srt(track, text));
    else
        return cn_fail(CN_ERR_FORMAT, "%s: no track of GPS; give a GPX, a KML with a gx:Track, or the SRT of a drone",
                       path);
    cn_gps_track_sort(track);
    return track->n ? CN_OK : cn_fail(CN_ERR_FORMAT, "%s: there is no place in this track", path);
}

cn_status cn_gps_track_read(cn_gps_track *track, const char *path)
{
    char *text;
    size_t size;
    *track = (cn_gps_track){ 0 };
    CN_TRY(cn_file_read(path, MOST_BYTES, &text, &size));
    const cn_status status = read_text(track, path, text, size);
    free(text);
    if (status != CN_OK) cn_gps_track_deinit(track);
    return status;
}
