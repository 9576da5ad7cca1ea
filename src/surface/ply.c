#include "surface/ply.h"

#include "base/file.h"
#include "base/number.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { MOST_PROPERTIES = 64, MOST_ELEMENTS = 8, MOST_CORNERS = 255 };

#define FARTHEST 1e30 /* metres; a float holds it */

typedef enum ply_type { PLY_I8, PLY_U8, PLY_I16, PLY_U16, PLY_I32, PLY_U32, PLY_F32, PLY_F64, PLY_TYPES } ply_type;
static const char *const type_names[PLY_TYPES][2] = { { "char", "int8" },     { "uchar", "uint8" },
                                                      { "short", "int16" },   { "ushort", "uint16" },
                                                      { "int", "int32" },     { "uint", "uint32" },
                                                      { "float", "float32" }, { "double", "float64" } };
static const size_t type_sizes[PLY_TYPES] = { 1, 1, 2, 2, 4, 4, 4, 8 };

typedef struct ply_property {
    bool list;
    ply_type count, type;
    int role; /* 0 to 2: x, y, z; 3: corners; -1: something else */
} ply_property;
typedef struct ply_element {
    char name[16];
    uint64_t n;
    ply_property properties[MOST_PROPERTIES];
    int n_properties;
} ply_element;
typedef struct ply_reader {
    const char *path, *at, *end;
    bool ascii;
    ply_element elements[MOST_ELEMENTS];
    int n_elements;
    cn_triangle_list *out;
    size_t room; /* of triangles */
} ply_reader;

static cn_status bad(const ply_reader *r, const char *what)
{
    return cn_fail(CN_ERR_FORMAT, "%s: not a PLY file that can be read: %s", r->path, what);
}

/* ---- header ---- */

static bool parse_type(const char *name, ply_type *type)
{
    for (int i = 0; i < PLY_TYPES; i++)
        if (strcmp(name, type_names[i][0]) == 0 || strcmp(name, type_names[i][1]) == 0) {
            *type = (ply_type)i;
            return true;
        }
    return false;
}

static int role_of(const char *name)
{
    static const char *const names[] = { "x", "y", "z", "vertex_indices", "vertex_index" };
    for (int i = 0; i < 5; i++)
        if (strcmp(name, names[i]) == 0) return i < 4 ? i : 3;
    return -1;
}

static cn_status add_property(ply_reader *r, const char *line)
{
    char a[16], b[16], c[32];
    if (!r->n_elements || r->elements[r->n_elements - 1].n_properties == MOST_PROPERTIES)
        return bad(r, "a property without an element, or more than 64 of them");
    ply_element *e = &r->elements[r->n_elements - 1];
    ply_property p = { 0 };
    p.list = sscanf(line, "property list %15s %15s %31s", a, b, c) == 3;
    if (p.list ? !parse_type(a, &p.count) || !parse_type(b, &p.type)
               : sscanf(line, "property %15s %31s", b, c) != 2 || !parse_type(b, &p.type))
        return bad(r, "a property of an unknown type");
    p.role = role_of(c);
    e->properties[e->n_properties++] = p;
    return CN_OK;
}

static cn_status read_header_line(ply_reader *r, const char *line)
{
    char text[32];
    unsigned long long n;
    if (sscanf(line, "format %31s", text) == 1) {
        r->ascii = strcmp(text, "ascii") == 0;
        return r->ascii || strcmp(text, "binary_little_endian") == 0
                   ? CN_OK
                   : bad(r, "only ascii and binary_little_endian are read");
    }
    if (sscanf(line, "element %15s %llu", text, &n) == 2) {
        if (r->n_elements == MOST_ELEMENTS) return bad(r, "more than 8 elements");
        ply_element *e = &r->elements[r->n_elements++];
        *e = (ply_element){ .n = n };
        snprintf(e->name, sizeof e->name, "%.15s", text);
        return CN_OK;
    }
    return strncmp(line, "property ", 9) == 0 ? add_property(r, line) : CN_OK;
}

static cn_status read_header(ply_reader *r)
{
    for (int i = 0;; i++) {
        const char *stop = memchr(r->at, '\n', (size_t)(r->end - r->at));
        char line[128];
        if (!stop) return bad(r, "its header does not end");
        snprintf(line, sizeof line, "%.*s", (int)(stop - r->at < 127 ? stop - r->at : 127), r->at);
        line[strcspn(line, "\r")] = '\0';
        r->at = stop + 1;
        if (i == 0 && strcmp(line, "ply") != 0) return bad(r, "its first line is not 'ply'");
        if (strcmp(line, "end_header") == 0) return CN_OK;
        if (i > 0) CN_TRY(read_header_line(r, line));
    }
}

/* ---- values ---- */

static double from_bytes(const char *at, ply_type type)
{
    uint64_t bits = 0;
    float f;
    double d;
    for (size_t b = 0; b < type_sizes[type]; b++)
        bits |= (uint64_t)(uint8_t)at[b] << (8 * b);
    const uint32_t low = (uint32_t)bits;
    memcpy(&f, &low, sizeof f);
    memcpy(&d, &bits, sizeof d);
    switch (type) {
    case PLY_I8: return (int8_t)bits;
    case PLY_I16: return (int16_t)bits;
    case PLY_I32: return (int32_t)bits;
    case PLY_F32: return (double)f;
    case PLY_F64: return d;
    default: return (double)bits;
    }
}

static cn_status next_value(ply_reader *r, ply_type type, double *value)
{
    if (!r->ascii) {
        if ((size_t)(r->end - r->at) < type_sizes[type]) return bad(r, "it ends too early");
        *value = from_bytes(r->at, type);
        r->at += type_sizes[type];
        return CN_OK;
    }
    char *stop;
    *value = cn_parse_double(r->at, &stop); /* the file is NUL-terminated */
    if (stop == r->at) return bad(r, "it ends too early, or has a word in place of a number");
    r->at = stop;
    return CN_OK;
}

static cn_status add_triangle(ply_reader *r, uint32_t a, uint32_t b, uint32_t c)
{
    cn_triangle_list *out = r->out;
    if (out->n_triangles == UINT32_MAX) return bad(r, "more than 4 billion triangles");
    if (out->n_triangles == r->room) {
        const size_t room = r->room ? 2 * r->room : 1024;
        uint32_t(*corners)[3] = realloc(out->corners, room * sizeof *corners);
        if (!corners) return cn_fail(CN_ERR_NOMEM, "out of memory for the triangles of %s", r->path);
        out->corners = corners;
        r->room = room;
    }
    memcpy(out->corners[out->n_triangles++], (const uint32_t[3]){ a, b, c }, sizeof *out->corners);
    return CN_OK;
}

static cn_status read_list(ply_reader *r, const ply_property *p, bool corners)
{
    double n = 0, value = 0;
    uint32_t fan[2] = { 0 };
    CN_TRY(next_value(r, p->count, &n));
    if (!(n >= 0 && n <= MOST_CORNERS)) return bad(r, "a face of more than 255 corners");
    for (int i = 0; i < (int)n; i++) {
        CN_TRY(next_value(r, p->type, &value));
        if (!corners) continue;
        if (!(value >= 0 && value < r->out->n_places)) return bad(r, "a face with a corner that is not there");
        const uint32_t corner = (uint32_t)value;
        if (i >= 2) CN_TRY(add_triangle(r, fan[0], fan[1], corner));
        fan[i > 0] = corner;
    }
    return CN_OK;
}

static cn_status read_row(ply_reader *r, const ply_element *e, float *place)
{
    for (int i = 0; i < e->n_properties; i++) {
        const ply_property *p = &e->properties[i];
        double value = 0;
        if (p->list) {
            CN_TRY(read_list(r, p, !place && p->role == 3));
            continue;
        }
        CN_TRY(next_value(r, p->type, &value));
        if (place && p->role >= 0 && !(fabs(value) < FARTHEST)) return bad(r, "a place that is not finite");
        if (place && p->role >= 0 && p->role < 3) place[p->role] = (float)value;
    }
    return CN_OK;
}

static cn_status read_elements(ply_reader *r)
{
    for (int i = 0; i < r->n_elements; i++) {
        const ply_element *e = &r->elements[i];
        const bool vertices = strcmp(e->name, "vertex") == 0;
        /* A row has a byte at least. */
        if ((e->n_properties || vertices) && e->n > (uint64_t)(r->end - r->at)) return bad(r, "it ends too early");
        if (vertices) {
            if (r->out->places || e->n >= UINT32_MAX) return bad(r, "its vertices are too many, or there twice");
            r->out->places = calloc((size_t)e->n + 1, sizeof *r->out->places);
            if (!r->out->places) return cn_fail(CN_ERR_NOMEM, "out of memory for the places of %s", r->path);
            r->out->n_places = (uint32_t)e->n;
        }
        for (uint64_t k = 0; e->n_properties && k < e->n; k++)
            CN_TRY(read_row(r, e, vertices ? r->out->places[k] : NULL));
    }
    return r->out->n_places ? CN_OK : bad(r, "it has no vertices");
}

cn_status cn_ply_read(cn_triangle_list *list, const char *path)
{
    char *data;
    size_t size;
    *list = (cn_triangle_list){ 0 };
    CN_TRY(cn_file_read(path, (size_t)16 << 30, &data, &size));
    ply_reader *r = calloc(1, sizeof *r);
    cn_status status = r ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory for %s", path);
    if (r) *r = (ply_reader){ .path = path, .at = data, .end = data + size, .out = list };
    if (status == CN_OK) status = read_header(r);
    if (status == CN_OK) status = read_elements(r);
    if (status != CN_OK) cn_triangle_list_deinit(list);
    free(r);
    free(data);
    return status;
}

void cn_triangle_list_deinit(cn_triangle_list *list)
{
    free(list->places);
    free(list->corners);
    *list = (cn_triangle_list){ 0 };
}
