#include "base/json.h"
#include "base/units.h"
#include "geo/heights.h"
#include "math/linalg.h"
#include "path/camera.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* The blocks of the binary chunk, one after another: times, places, directions and, where they change, fields of view.
 */
enum { TIMES, PLACES, TURNS, FOVS, BLOCKS };
static const int widths[BLOCKS] = { 1, 3, 4, 1 };
static const char *const types[BLOCKS] = { "SCALAR", "VEC3", "VEC4", "SCALAR" };

typedef struct gltf_output {
    const cn_path *path;
    const cn_path_note *note;
    float *values[BLOCKS]; /* n_frames * width */
    int n_blocks;
} gltf_output;

static cn_status fill(gltf_output *o)
{
    double before[4] = { 0 };
    bool zooms = false;
    const uint32_t n = o->path->n_frames;
    for (int b = 0; b < BLOCKS; b++)
        if (!(o->values[b] = calloc((size_t)n * (size_t)widths[b] + 1, sizeof(float))))
            return cn_fail(CN_ERR_NOMEM, "out of memory for a camera of %u frames", n);
    for (uint32_t i = 0; i < n; i++) {
        const cn_path_sample s = cn_path_sample_of(&o->path->frames[i]);
        double q[4];
        cn_mat3_to_quat(s.rotation, q);
        double same = 0;
        for (int k = 0; k < 4; k++)
            same += q[k] * before[k];
        for (int k = 0; k < 4; k++) /* the shorter way from the frame before */
            before[k] = same < 0 ? -q[k] : q[k];
        o->values[TIMES][i] = (float)(i / o->path->fps); /* as the film shows it, however the path was timed */
        for (int k = 0; k < 3; k++) {
            o->values[PLACES][3 * i + (uint32_t)k] = (float)s.centre[k];
            o->values[TURNS][4 * i + (uint32_t)k] = (float)before[k + 1]; /* x y z, then w */
        }
        o->values[TURNS][4 * i + 3] = (float)before[0];
        o->values[FOVS][i] = (float)cn_radians(s.vfov_deg);
        zooms = zooms || fabsf(o->values[FOVS][i] - o->values[FOVS][0]) > 1e-6f;
    }
    o->n_blocks = n < 2 ? 0 : zooms ? BLOCKS : FOVS;
    return CN_OK;
}

static json_t *reals(const float *values, int n)
{
    double wide[4];
    for (int k = 0; k < n; k++)
        wide[k] = (double)values[k];
    return cn_json_reals(wide, (size_t)n);
}

static json_t *node_json(const gltf_output *o)
{
    return json_pack("{s:s, s:i, s:o, s:o}", "name", "camera", "camera", 0, "translation", reals(o->values[PLACES], 3),
                     "rotation", reals(o->values[TURNS], 4));
}

static json_t *camera_json(const gltf_output *o)
{
    const cn_camera *c = &o->path->frames[0].camera;
    return json_pack("{s:s, s:s, s:{s:f, s:f, s:f}}", "type", "perspective", "name", "camera", "perspective", "yfov",
                     (double)o->values[FOVS][0], "aspectRatio", (double)c->width / c->height, "znear", 0.1);
}

static json_t *animation_json(const gltf_output *o)
{
    static const char *const paths[BLOCKS] = { NULL, "translation", "rotation", "pointer" };
    json_t *channels = json_array(), *samplers = json_array();
    for (int b = PLACES; b < o->n_blocks; b++) {
        json_t *target = b == FOVS ? json_pack("{s:s, s:{s:{s:s}}}", "path", paths[b], "extensions",
                                               "KHR_animation_pointer", "pointer", "/cameras/0/perspective/yfov")
                                   : json_pack("{s:i, s:s}", "node", 0, "path", paths[b]);
        json_array_append_new(channels, json_pack("{s:i, s:o}", "sampler", b - 1, "target", target));
        json_array_append_new(samplers,
                              json_pack("{s:i, s:i, s:s}", "input", TIMES, "output", b, "interpolation", "LINEAR"));
    }
    return json_pack("{s:s, s:o, s:o}", "name", "flight", "channels", channels, "samplers", samplers);
}

static void add_blocks(const gltf_output *o, json_t *root)
{
    json_t *views = json_array(), *accessors = json_array();
    const json_int_t n = o->path->n_frames;
    json_int_t at = 0;
    for (int b = 0; b < o->n_blocks; b++) {
        const json_int_t size = n * widths[b] * 4;
        json_array_append_new(views, json_pack("{s:i, s:I, s:I}", "buffer", 0, "byteOffset", at, "byteLength", size));
        json_t *accessor =
            json_pack("{s:i, s:i, s:I, s:s}", "bufferView", b, "componentType", 5126, "count", n, "type", types[b]);
        if (b == TIMES) {
            json_object_set_new(accessor, "min", reals(o->values[b], 1));
            json_object_set_new(accessor, "max", reals(o->values[b] + n - 1, 1));
        }
        json_array_append_new(accessors, accessor);
        at += size;
    }
    json_object_set_new(root, "bufferViews", views);
    json_object_set_new(root, "accessors", accessors);
    json_object_set_new(root, "buffers", json_pack("[{s:I}]", "byteLength", at));
    json_object_set_new(root, "animations", json_pack("[o]", animation_json(o)));
    if (o->n_blocks == BLOCKS) json_object_set_new(root, "extensionsUsed", json_pack("[s]", "KHR_animation_pointer"));
}

static json_t *extras_json(const gltf_output *o)
{
    const cn_frame *f = o->note->frame;
    json_t *extras =
        json_pack("{s:f, s:s, s:s}", "fps", o->path->fps, "axes", "x east, y up, z south; metres from the origin",
                  "flight", o->note->flight ? o->note->flight : "");
    if (extras && f && f->georeferenced)
        json_object_set_new(extras, "origin_wgs84",
                            json_pack("{s:f, s:f, s:f, s:s}", "latitude_deg", f->latitude_deg, "longitude_deg",
                                      f->longitude_deg, "height_m", f->height_m, "heights", cn_frame_heights(f)));
    return extras;
}

static json_t *gltf_json(const gltf_output *o)
{
    char generator[32];
    snprintf(generator, sizeof generator, "Conurb %s", cn_version());
    json_t *root = json_pack("{s:{s:s, s:s}, s:i, s:[{s:[i]}], s:[o], s:[o], s:o}", "asset", "version", "2.0",
                             "generator", generator, "scene", 0, "scenes", "nodes", 0, "nodes", node_json(o), "cameras",
                             camera_json(o), "extras", extras_json(o));
    if (root && o->n_blocks) add_blocks(o, root);
    return root;
}

static void write_32(FILE *stream, uint32_t value)
{
    for (int b = 0; b < 4; b++)
        fputc((int)(value >> (8 * b) & 0xff), stream);
}

static void write_blocks(const gltf_output *o, FILE *stream)
{
    for (int b = 0; b < o->n_blocks; b++)
        for (size_t i = 0; i < (size_t)o->path->n_frames * (size_t)widths[b]; i++) {
            uint32_t bits;
            memcpy(&bits, &o->values[b][i], sizeof bits);
            write_32(stream, bits);
        }
}

static cn_status write_all(const gltf_output *o, FILE *stream)
{
    json_t *root = gltf_json(o);
    char *text = root ? json_dumps(root, JSON_COMPACT | JSON_REAL_PRECISION(17)) : NULL;
    uint32_t size = 0;
    json_decref(root);
    if (!text) return cn_fail(CN_ERR_NOMEM, "out of memory for a camera of %u frames", o->path->n_frames);
    for (int b = 0; b < o->n_blocks; b++)
        size += o->path->n_frames * (uint32_t)widths[b] * 4;
    const uint32_t length = (uint32_t)strlen(text), padded = (length + 3) / 4 * 4;
    write_32(stream, 0x46546c67);
    write_32(stream, 2);
    write_32(stream, 20 + padded + (size ? 8 + size : 0));
    write_32(stream, padded);
    write_32(stream, 0x4e4f534a);
    fprintf(stream, "%s%*s", text, (int)(padded - length), "");
    free(text);
    if (!size) return CN_OK;
    write_32(stream, size);
    write_32(stream, 0x004e4942);
    write_blocks(o, stream);
    return CN_OK;
}

cn_status cn_gltf_write(FILE *stream, const cn_path *path, const cn_path_note *note)
{
    gltf_output o = { .path = path, .note = note };
    cn_status status = fill(&o);
    if (status == CN_OK) status = write_all(&o, stream);
    for (int b = 0; b < BLOCKS; b++)
        free(o.values[b]);
    return status;
}
