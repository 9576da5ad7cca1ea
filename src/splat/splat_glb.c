#include "splat/splat_tiles.h"

#include "base/file.h"
#include "base/json.h"
#include "splat/splat_file.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { FLOAT = 5126, SHORT = 5122, UBYTE = 5121, ARRAY_BUFFER = 34962, POINTS = 0, MOST_BYTES = 12 + 4 + 8 + 16 + 48 };
#define HALF 0.70710678f
#define Y00 0.28209479f
#define NAME "KHR_gaussian_splatting"
#define SPZ NAME "_compression_spz_2"

typedef struct glb {
    const cn_splats *s;
    uint8_t *bytes; /* one attribute after another, each on a multiple of 4 */
    size_t size, room;
    bool compressed;
    json_t *views, *accessors, *attributes;
    float low[3], high[3];
} glb;

/* x east, y north, z up becomes x east, y up, z south. */
static void place_of(const cn_splats *s, size_t i, float out[3])
{
    out[0] = (float)(s->origin[0] + (double)s->centre[i][0]);
    out[1] = (float)(s->origin[2] + (double)s->centre[i][2]);
    out[2] = (float)-(s->origin[1] + (double)s->centre[i][1]);
}

static void put_float(glb *g, float value)
{
    uint32_t bits;
    memcpy(&bits, &value, sizeof bits);
    for (int b = 0; b < 4; b++)
        g->bytes[g->size++] = (uint8_t)(bits >> (8 * b));
}

/* Names what was written from `first` on. */
static void note(glb *g, const char *name, size_t first, int kind, const char *type)
{
    const size_t bytes = g->size - first;
    json_t *view = json_pack("{s:i, s:I, s:I, s:i}", "buffer", 0, "byteOffset", (json_int_t)first, "byteLength",
                             (json_int_t)bytes, "target", ARRAY_BUFFER);
    json_t *accessor = json_pack("{s:i, s:i, s:I, s:s}", "bufferView", (int)json_array_size(g->views), "componentType",
                                 kind, "count", (json_int_t)g->s->n, "type", type);
    if (kind != FLOAT) json_object_set_new(accessor, "normalized", json_true());
    json_object_set_new(g->attributes, name, json_integer((json_int_t)json_array_size(g->accessors)));
    json_array_append_new(g->views, view);
    json_array_append_new(g->accessors, accessor);
}

static void put_places(glb *g)
{
    const size_t first = g->size;
    for (int k = 0; k < 3; k++) {
        g->low[k] = INFINITY;
        g->high[k] = -INFINITY;
    }
    for (size_t i = 0; i < g->s->n; i++) {
        float place[3];
        place_of(g->s, i, place);
        for (int k = 0; k < 3; k++) {
            g->low[k] = fminf(g->low[k], place[k]);
            g->high[k] = fmaxf(g->high[k], place[k]);
            put_float(g, place[k]);
        }
    }
    note(g, "POSITION", first, FLOAT, "VEC3");
    const double low[3] = { (double)g->low[0], (double)g->low[1], (double)g->low[2] };
    const double high[3] = { (double)g->high[0], (double)g->high[1], (double)g->high[2] };
    json_object_set_new(json_array_get(g->accessors, 0), "min", cn_json_reals(low, 3));
    json_object_set_new(json_array_get(g->accessors, 0), "max", cn_json_reals(high, 3));
}

static size_t row_of(const cn_splats *s)
{
    return (size_t)(s->degree + 1) * (s->degree + 1) * 3;
}

static void put_points(glb *g)
{
    const size_t first = g->size;
    for (size_t i = 0; i < g->s->n; i++) {
        for (size_t k = 0; k < 3; k++) {
            /* Points are drawn in linear light. */
            const float c = fminf(fmaxf(0.5f + Y00 * g->s->colour[i * row_of(g->s) + k], 0), 1);
            const float linear = c <= 0.04045f ? c / 12.92f : powf((c + 0.055f) / 1.055f, 2.4f);
            g->bytes[g->size++] = (uint8_t)lrintf(255 * linear);
        }
        g->bytes[g->size++] = (uint8_t)lrintf(255 * fminf(fmaxf(g->s->opacity[i], 0), 1));
    }
    note(g, "COLOR_0", first, UBYTE, "VEC4");
}

static void put_rotations(glb *g)
{
    const size_t first = g->size;
    for (size_t i = 0; i < g->s->n; i++) {
        const float *q = g->s->rotation[i]; /* turned by -90 degrees about x; x y z w */
        const float turned[4] = { HALF * (q[1] - q[0]), HALF * (q[2] + q[3]), HALF * (q[3] - q[2]),
                                  HALF * (q[0] + q[1]) };
        for (int k = 0; k < 4; k++) {
            const uint16_t v = (uint16_t)(int16_t)lrintf(32767 * fminf(fmaxf(turned[k], -1), 1));
            g->bytes[g->size++] = (uint8_t)v;
            g->bytes[g->size++] = (uint8_t)(v >> 8);
        }
    }
    /* What SPZ holds is decoded to floats; CesiumJS reads them as what the accessor says. */
    note(g, NAME ":ROTATION", first, g->compressed ? FLOAT : SHORT, "VEC4");
}

static void put_shapes(glb *g)
{
    size_t first = g->size;
    for (size_t i = 0; i < g->s->n; i++)
        for (int k = 0; k < 3; k++)
            put_float(g, g->s->scale[i][k]);
    note(g, NAME ":SCALE", first, FLOAT, "VEC3");
    if (g->compressed) return; /* COLOR_0 has the opacity and degree 0 then */
    first = g->size;
    for (size_t i = 0; i < g->s->n; i++)
        put_float(g, fminf(fmaxf(g->s->opacity[i], 0), 1));
    note(g, NAME ":OPACITY", first, FLOAT, "SCALAR");
}

/* Degree 1 is a vector, which turns with the axes. */
static void put_harmonics(glb *g)
{
    static const char *const names[4] = { NAME ":SH_DEGREE_0_COEF_0", NAME ":SH_DEGREE_1_COEF_0",
                                          NAME ":SH_DEGREE_1_COEF_1", NAME ":SH_DEGREE_1_COEF_2" };
    static const size_t from[4] = { 0, 6, 3, 9 };
    for (int c = g->compressed ? 1 : 0; c < (g->s->degree ? 4 : 1); c++) {
        const size_t first = g->size;
        for (size_t i = 0; i < g->s->n; i++)
            for (size_t k = 0; k < 3; k++)
                put_float(g, (c == 1 ? -1 : 1) * g->s->colour[i * row_of(g->s) + from[c] + k]);
        note(g, names[c], first, FLOAT, "VEC3");
    }
}

/* Attributes whose values SPZ gives: no accessor has a view of its own. */
static cn_status put_spz(glb *g, const char *path)
{
    char *text = NULL;
    size_t size = 0, i;
    json_t *accessor;
    FILE *stream = open_memstream(&text, &size);
    if (!stream) return cn_fail(CN_ERR_NOMEM, "out of memory for %s", path);
    cn_status status = cn_splat_spz_stream(g->s, stream, path);
    if (fclose(stream) != 0 && status == CN_OK) status = cn_fail(CN_ERR_NOMEM, "out of memory for %s", path);
    if (status == CN_OK && size > g->room) status = cn_fail(CN_ERR_NOMEM, "out of memory for %s", path);
    if (status == CN_OK) {
        memcpy(g->bytes, text, size);
        g->size = size;
        json_array_foreach(g->accessors, i, accessor) json_object_del(accessor, "bufferView");
        json_array_clear(g->views);
        json_array_append_new(
            g->views, json_pack("{s:i, s:i, s:I}", "buffer", 0, "byteOffset", 0, "byteLength", (json_int_t)size));
    }
    free(text);
    return status;
}

static json_t *primitive_of(const glb *g)
{
    json_t *extension = json_pack("{s:s, s:s}", "kernel", "ellipse", "colorSpace", "srgb_rec709_display");
    if (g->compressed) json_object_set_new(extension, "extensions", json_pack("{s:{s:i}}", SPZ, "bufferView", 0));
    return json_pack("{s:i, s:O, s:{s:o}}", "mode", POINTS, "attributes", g->attributes, "extensions", NAME, extension);
}

static json_t *gltf_of(const glb *g, const cn_splat_about *about)
{
    char generator[32];
    snprintf(generator, sizeof generator, "Conurb %s", cn_version());
    json_t *root = json_pack("{s:{s:s, s:s, s:{s:s, s:s}}, s:[s], s:[{s:I}], s:O, s:O, s:[{s:[o]}], s:[{s:i}], "
                             "s:[{s:[i]}], s:i}",
                             "asset", "version", "2.0", "generator", generator, "extras", "light",
                             about->light ? about->light : "mean", "tiles", about->tiles ? about->tiles : "",
                             "extensionsUsed", NAME, "buffers", "byteLength", (json_int_t)g->size, "bufferViews",
                             g->views, "accessors", g->accessors, "meshes", "primitives", primitive_of(g), "nodes",
                             "mesh", 0, "scenes", "nodes", 0, "scene", 0);
    if (root && g->compressed) {
        json_array_append_new(json_object_get(root, "extensionsUsed"), json_string(SPZ));
        json_object_set_new(root, "extensionsRequired", json_pack("[s, s]", NAME, SPZ));
    }
    return root;
}

static void write_u32(FILE *stream, size_t value)
{
    for (int b = 0; b < 4; b++)
        fputc((int)(value >> (8 * b) & 255), stream);
}

static cn_status write_file(const glb *g, const cn_splat_about *about, const char *path)
{
    cn_writer writer;
    json_t *json = gltf_of(g, about);
    char *text = json ? json_dumps(json, JSON_COMPACT | JSON_SORT_KEYS | JSON_REAL_PRECISION(9)) : NULL;
    json_decref(json);
    if (!text) return cn_fail(CN_ERR_NOMEM, "out of memory for %s", path);
    const size_t length = (strlen(text) + 3) / 4 * 4, size = (g->size + 3) / 4 * 4;
    const cn_status status = cn_writer_open(&writer, path);
    if (status == CN_OK) {
        fwrite("glTF\2\0\0\0", 1, 8, writer.stream);
        write_u32(writer.stream, 12 + 8 + length + 8 + size);
        write_u32(writer.stream, length);
        fprintf(writer.stream, "JSON%-*s", (int)length, text);
        write_u32(writer.stream, size);
        fwrite("BIN\0", 1, 4, writer.stream);
        fwrite(g->bytes, 1, g->size, writer.stream);
        for (size_t i = g->size; i < size; i++)
            fputc(0, writer.stream);
    }
    free(text);
    return status == CN_OK ? cn_writer_commit(&writer) : status;
}

cn_status cn_splat_glb_write(const cn_splats *splats, const cn_splat_about *about, bool compressed, const char *path)
{
    glb g = { .s = splats, .compressed = compressed, .room = splats->n * MOST_BYTES + 4096 };
    if (splats->degree > 1) return cn_fail(CN_ERR_USAGE, "%s: harmonics of degree %u", path, splats->degree);
    g.bytes = malloc(g.room);
    g.views = json_array();
    g.accessors = json_array();
    g.attributes = json_object();
    cn_status status =
        g.bytes && g.views && g.accessors && g.attributes ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory for %s", path);
    if (status == CN_OK) {
        put_places(&g);
        put_points(&g);
        put_rotations(&g);
        put_shapes(&g);
        put_harmonics(&g);
        if (compressed) status = put_spz(&g, path);
    }
    if (status == CN_OK) status = write_file(&g, about, path);
    free(g.bytes);
    json_decref(g.views);
    json_decref(g.accessors);
    json_decref(g.attributes);
    return status;
}
