#include "pose/metashape_xml.h"

#include "base/file.h"
#include "base/number.h"

#include <expat.h>
#include <limits.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { DEEPEST = 32, MOST_TEXT = 1024, MOST_ITEMS = 10000000 };

typedef struct reader {
    const char *path;
    XML_Parser parser;
    cn_status status;
    cn_metashape *out;
    int depth, chunk; /* chunk: number of the one that is open or was last */
    long component;   /* the same */
    char names[DEEPEST][24];
    char text[MOST_TEXT];
    size_t length;
    bool too_long, passed_over; /* passed_over: the calibration that is open does not count */
} reader;

static void refuse(reader *r, const char *what)
{
    if (r->status != CN_OK) return;
    r->status =
        cn_fail(CN_ERR_FORMAT, "%s, line %lu: %s", r->path, (unsigned long)XML_GetCurrentLineNumber(r->parser), what);
    XML_StopParser(r->parser, XML_FALSE);
}

/* Room for one more item of a list that grows in powers of two. NULL, refused: out of memory. */
static void *grow(reader *r, void *items, size_t n, size_t size)
{
    if (n & (n - 1)) return items;
    void *more = n < MOST_ITEMS ? realloc(items, (n ? 2 * n : 1) * size) : NULL;
    if (!more) refuse(r, "out of memory");
    return more;
}

static const char *attribute(const XML_Char **attributes, const char *name)
{
    for (; *attributes; attributes += 2)
        if (strcmp(attributes[0], name) == 0) return attributes[1];
    return NULL;
}

/* A number of an attribute; `fallback` where it is missing. */
static long whole(reader *r, const XML_Char **attributes, const char *name, long fallback)
{
    char *end;
    const char *text = attribute(attributes, name);
    if (!text) return fallback;
    const long value = strtol(text, &end, 10);
    if (end == text || *end || value < 0 || value == LONG_MAX) refuse(r, "an id that is no number");
    return value;
}

static bool is_no(const char *text)
{
    return text && (strcmp(text, "0") == 0 || strcmp(text, "false") == 0);
}

/* Whether the open element is so many levels below one of this name. */
static bool is_in(const reader *r, const char *name, int levels)
{
    const int at = r->depth - 1 - levels;
    return at >= 0 && at < DEEPEST && strcmp(r->names[at], name) == 0;
}

/* ---- an element begins ---- */

static void begin_sensor(reader *r, const XML_Char **attributes)
{
    cn_metashape *out = r->out;
    cn_metashape_sensor *more = grow(r, out->sensors, out->n_sensors, sizeof *more);
    if (!more) return;
    out->sensors = more;
    const char *type = attribute(attributes, "type");
    cn_metashape_sensor *s = &more[out->n_sensors++];
    *s = (cn_metashape_sensor){ .chunk = r->chunk, .id = whole(r, attributes, "id", 0) };
    snprintf(s->type, sizeof s->type, "%s", type ? type : "frame");
    s->lens = strcmp(s->type, "frame") == 0       ? CN_METASHAPE_FRAME
              : strcmp(s->type, "fisheye") == 0   ? CN_METASHAPE_FISHEYE
              : strcmp(s->type, "spherical") == 0 ? CN_METASHAPE_SPHERICAL
                                                  : CN_METASHAPE_OTHER;
}

static void begin_shot(reader *r, const XML_Char **attributes)
{
    cn_metashape *out = r->out;
    const char *label = attribute(attributes, "label");
    cn_metashape_shot *more = grow(r, out->shots, out->n_shots, sizeof *more);
    if (!more) return;
    out->shots = more;
    if (!label || !*label) {
        refuse(r, "a camera without a label");
        return;
    }
    cn_metashape_shot *s = &more[out->n_shots++];
    *s = (cn_metashape_shot){ .chunk = r->chunk,
                              .sensor = whole(r, attributes, "sensor_id", 0),
                              .component = whole(r, attributes, "component_id", -1),
                              .enabled = !is_no(attribute(attributes, "enabled")),
                              .label = strdup(label) };
    if (!s->label) refuse(r, "out of memory");
}

static void begin_part(reader *r, long component)
{
    cn_metashape *out = r->out;
    cn_metashape_part *more = grow(r, out->parts, out->n_parts, sizeof *more);
    if (!more) return;
    out->parts = more;
    more[out->n_parts++] = (cn_metashape_part){ r->chunk, component, { 1, 0, 0, 0, 1, 0, 0, 0, 1 }, { 0 }, 1.0 };
}

/* A camera that was calibrated before, or whose photos hold a calibration, has two: class "initial", and "adjusted",
 * which is the one of the poses. A term that a calibration leaves out is 0. */
static void begin_calibration(reader *r, const XML_Char **attributes)
{
    if (!r->out->n_sensors) return;
    const char *class = attribute(attributes, "class");
    cn_metashape_sensor *s = &r->out->sensors[r->out->n_sensors - 1];
    r->passed_over = s->adjusted;
    if (r->passed_over) return;
    s->adjusted = class && strcmp(class, "adjusted") == 0;
    s->f = 0.0;
    memset(s->c, 0, sizeof s->c);
    memset(s->k, 0, sizeof s->k);
    memset(s->p, 0, sizeof s->p);
    memset(s->b, 0, sizeof s->b);
}

/* The size of a sensor; that of its calibration, which comes later, is the one that counts. */
static void take_size(reader *r, const XML_Char **attributes)
{
    if (!r->out->n_sensors) return;
    cn_metashape_sensor *s = &r->out->sensors[r->out->n_sensors - 1];
    s->width = (double)whole(r, attributes, "width", 0);
    s->height = (double)whole(r, attributes, "height", 0);
}

static void XMLCALL on_begin(void *user, const XML_Char *name, const XML_Char **attributes)
{
    reader *r = user;
    if (r->depth >= DEEPEST) {
        refuse(r, "elements are nested too deeply");
        return;
    }
    snprintf(r->names[r->depth++], sizeof r->names[0], "%s", name);
    r->length = 0;
    r->too_long = false;
    if (strcmp(name, "chunk") == 0) r->chunk++;
    if (strcmp(name, "sensor") == 0 && is_in(r, "sensors", 1)) begin_sensor(r, attributes);
    if (strcmp(name, "camera") == 0 && (is_in(r, "cameras", 1) || is_in(r, "group", 1))) begin_shot(r, attributes);
    if (strcmp(name, "component") == 0 && is_in(r, "components", 1)) r->component = whole(r, attributes, "id", 0);
    /* A component without a transform is in the coordinates of its chunk. */
    if (strcmp(name, "transform") == 0 && is_in(r, "component", 1)) begin_part(r, r->component);
    if (strcmp(name, "transform") == 0 && is_in(r, "chunk", 1)) begin_part(r, -1);
    const bool calibrates = is_in(r, "sensor", 2) && is_in(r, "calibration", 1);
    if (strcmp(name, "calibration") == 0 && is_in(r, "sensor", 1)) begin_calibration(r, attributes);
    if (strcmp(name, "resolution") == 0 && (is_in(r, "sensor", 1) || (calibrates && !r->passed_over)))
        take_size(r, attributes);
}

/* ---- its text ---- */

static void XMLCALL on_text(void *user, const XML_Char *text, int length)
{
    reader *r = user;
    for (int i = 0; i < length; i++)
        if (r->length + 1 < sizeof r->text)
            r->text[r->length++] = text[i];
        else
            r->too_long = true;
}

static void numbers(reader *r, double *values, int n)
{
    char *text = r->text, *end;
    r->text[r->length] = '\0';
    for (int i = 0; i < n; i++, text = end) {
        values[i] = cn_parse_double(text, &end);
        if (end == text || !isfinite(values[i])) {
            refuse(r, "an element lacks a number");
            return;
        }
    }
    if (r->too_long || text[strspn(text, " \t\r\n")]) refuse(r, "an element has more than its numbers");
}

static void take_calibration(reader *r, const char *name)
{
    static const char *const NAMES[] = { "f", "cx", "cy", "k1", "k2", "k3", "k4", "p1", "p2", "b1", "b2" };
    if (!r->out->n_sensors) return;
    cn_metashape_sensor *s = &r->out->sensors[r->out->n_sensors - 1];
    double *const to[] = { &s->f,    &s->c[0], &s->c[1], &s->k[0], &s->k[1], &s->k[2],
                           &s->k[3], &s->p[0], &s->p[1], &s->b[0], &s->b[1] };
    for (size_t i = 0; i < sizeof NAMES / sizeof *NAMES; i++)
        if (strcmp(name, NAMES[i]) == 0) numbers(r, to[i], 1);
}

static void take_part(reader *r, const char *name)
{
    if (!r->out->n_parts || !(is_in(r, "component", 2) || is_in(r, "chunk", 2))) return;
    cn_metashape_part *part = &r->out->parts[r->out->n_parts - 1];
    if (strcmp(name, "rotation") == 0) numbers(r, part->rotation, 9);
    if (strcmp(name, "translation") == 0) numbers(r, part->translation, 3);
    if (strcmp(name, "scale") == 0) numbers(r, &part->scale, 1);
}

static void XMLCALL on_end(void *user, const XML_Char *name)
{
    reader *r = user;
    if (is_in(r, "calibration", 1) && is_in(r, "sensor", 2) && !r->passed_over) take_calibration(r, name);
    if (is_in(r, "transform", 1)) take_part(r, name);
    if (strcmp(name, "transform") == 0 && is_in(r, "camera", 1) && r->out->n_shots) {
        cn_metashape_shot *shot = &r->out->shots[r->out->n_shots - 1];
        numbers(r, shot->transform, 16);
        shot->aligned = true;
    }
    r->depth--;
    r->length = 0;
    r->too_long = false;
}

static cn_status parse(reader *r, const char *text, size_t size)
{
    r->parser = XML_ParserCreate(NULL);
    if (!r->parser || size > INT_MAX) return cn_fail(CN_ERR_NOMEM, "out of memory for %s", r->path);
    XML_SetUserData(r->parser, r);
    XML_SetElementHandler(r->parser, on_begin, on_end);
    XML_SetCharacterDataHandler(r->parser, on_text);
    if (XML_Parse(r->parser, text, (int)size, 1) != XML_STATUS_OK && r->status == CN_OK)
        r->status =
            cn_fail(CN_ERR_FORMAT, "%s, line %lu: not valid XML: %s", r->path,
                    (unsigned long)XML_GetCurrentLineNumber(r->parser), XML_ErrorString(XML_GetErrorCode(r->parser)));
    XML_ParserFree(r->parser);
    CN_TRY(r->status);
    if (r->chunk < 0 || !r->out->n_shots)
        return cn_fail(CN_ERR_FORMAT, "%s: no cameras of Metashape in it; give the file of File > Export > Cameras",
                       r->path);
    return CN_OK;
}

cn_status cn_metashape_read(const char *path, cn_metashape *out)
{
    char *text = NULL;
    size_t size;
    reader r = { .path = path, .out = out, .chunk = -1 };
    memset(out, 0, sizeof *out);
    CN_TRY(cn_file_read(path, 0, &text, &size));
    const cn_status status = parse(&r, text, size);
    free(text);
    if (status != CN_OK) cn_metashape_deinit(out);
    return status;
}

void cn_metashape_deinit(cn_metashape *file)
{
    for (size_t i = 0; i < file->n_shots; i++)
        free(file->shots[i].label);
    free(file->shots);
    free(file->sensors);
    free(file->parts);
    memset(file, 0, sizeof *file);
}
