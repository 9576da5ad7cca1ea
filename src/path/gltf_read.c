#include "base/file.h"
#include "base/json.h"
#include "base/units.h"
#include "math/linalg.h"
#include "path/camera.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { DEEPEST = 64, MOST_FRAMES = 1000000 };
#define MAX_BYTES (1u << 30)

typedef struct glb {
    const char *file;
    char *bytes;
    size_t size;
    json_t *root;
    const uint8_t *bin;
    size_t bin_size;
} glb;

static cn_status damaged(const glb *g, const char *what)
{
    return cn_fail(CN_ERR_FORMAT, "%s: %s; export the camera again as glTF binary (.glb)", g->file, what);
}

static uint32_t u32(const void *at)
{
    const uint8_t *b = at;
    return (uint32_t)b[0] | (uint32_t)b[1] << 8 | (uint32_t)b[2] << 16 | (uint32_t)b[3] << 24;
}

static cn_status open_glb(glb *g)
{
    json_error_t error;
    CN_TRY(cn_file_read(g->file, MAX_BYTES, &g->bytes, &g->size));
    if (g->size < 20 || u32(g->bytes + 4) != 2) return damaged(g, "no glTF 2.0");
    const size_t length = u32(g->bytes + 12);
    if (length > g->size - 20 || u32(g->bytes + 16) != 0x4e4f534a) return damaged(g, "its JSON is cut off");
    g->root = json_loadb(g->bytes + 20, length, 0, &error);
    if (!g->root || !json_is_object(g->root)) return damaged(g, "its JSON cannot be read");
    const size_t at = 20 + length;
    if (g->size - at < 8) return CN_OK;
    g->bin_size = u32(g->bytes + at);
    if (g->bin_size > g->size - at - 8) return damaged(g, "its data are cut off");
    g->bin = (const uint8_t *)g->bytes + at + 8;
    return CN_OK;
}

static void close_glb(glb *g)
{
    json_decref(g->root);
    free(g->bytes);
}

/* Element i of an array of the root; NULL when there is none. */
static json_t *item(const glb *g, const char *array, json_int_t i)
{
    return i < 0 ? NULL : json_array_get(json_object_get(g->root, array), (size_t)i);
}

static json_int_t whole(const json_t *object, const char *key, json_int_t fallback)
{
    const json_t *value = json_object_get(object, key);
    return json_is_integer(value) ? json_integer_value(value) : fallback;
}

static bool list_of(const json_t *object, const char *key, double *values, size_t n)
{
    const json_t *list = json_object_get(object, key);
    if (json_array_size(list) != n) return false;
    for (size_t k = 0; k < n; k++) {
        values[k] = json_number_value(json_array_get(list, k));
        if (!isfinite(values[k])) return false;
    }
    return true;
}

/* ---- accessors ---- */

/* An array of floats: n rows of `width`. */
typedef struct rows {
    const uint8_t *at;
    size_t stride, n, width;
} rows;

static cn_status rows_of(const glb *g, json_int_t index, rows *out)
{
    static const char *const types[] = { "SCALAR", "VEC2", "VEC3", "VEC4" };
    const json_t *accessor = item(g, "accessors", index);
    const json_t *view = item(g, "bufferViews", whole(accessor, "bufferView", -1));
    const char *type = json_string_value(json_object_get(accessor, "type"));
    *out = (rows){ 0 };
    for (size_t w = 0; type && w < 4; w++)
        if (strcmp(type, types[w]) == 0) out->width = w + 1;
    if (!view || !out->width || whole(accessor, "componentType", 0) != 5126 || json_object_get(accessor, "sparse") ||
        whole(view, "buffer", -1) != 0)
        return damaged(g, "an animation is not made of plain floats in the file");
    const json_int_t start = whole(view, "byteOffset", 0), length = whole(view, "byteLength", -1);
    const json_int_t from = whole(accessor, "byteOffset", 0), n = whole(accessor, "count", -1);
    const json_int_t stride = whole(view, "byteStride", (json_int_t)(4 * out->width));
    const json_int_t room = (json_int_t)g->bin_size, row = (json_int_t)(4 * out->width);
    if (!g->bin || start < 0 || length < 0 || start > room || length > room - start || from < 0 || from > length ||
        n < 1 || n > 3 * MOST_FRAMES || stride < row || stride > 255 || (n - 1) * stride + row > length - from)
        return damaged(g, "an animation lies outside of its data");
    out->at = g->bin + start + from;
    out->stride = (size_t)stride;
    out->n = (size_t)n;
    return CN_OK;
}

static double value_at(const rows *r, size_t i, size_t k)
{
    const uint32_t bits = u32(r->at + i * r->stride + 4 * k);
    float value;
    memcpy(&value, &bits, sizeof value);
    return (double)value;
}

/* ---- what moves ---- */

typedef enum moving { PLACE, TURN, SCALE, FOV, KINDS } moving;
typedef struct channel {
    rows times, values;
    bool step, cubic;
} channel;
/* The camera's node, and those above it. */
typedef struct chain {
    const json_t *nodes[DEEPEST];
    json_int_t index[DEEPEST];
    channel of[DEEPEST][KINDS]; /* n 0: it does not move */
    int n;
    json_int_t camera;
    double vfov_rad;
} chain;

static cn_status read_camera(const glb *g, chain *c)
{
    const json_t *lens = json_object_get(item(g, "cameras", c->camera), "perspective");
    c->vfov_rad = json_number_value(json_object_get(lens, "yfov"));
    return c->vfov_rad > 0 ? CN_OK : damaged(g, "its camera has no vertical field of view (yfov)");
}

static json_int_t parent_of(const glb *g, json_int_t child)
{
    const json_t *nodes = json_object_get(g->root, "nodes");
    for (size_t i = 0; i < json_array_size(nodes); i++) {
        const json_t *children = json_object_get(json_array_get(nodes, i), "children");
        for (size_t k = 0; k < json_array_size(children); k++)
            if (json_integer_value(json_array_get(children, k)) == child) return (json_int_t)i;
    }
    return -1;
}

static cn_status find_chain(const glb *g, chain *c)
{
    const json_t *nodes = json_object_get(g->root, "nodes");
    json_int_t at = -1;
    for (size_t i = 0; i < json_array_size(nodes) && at < 0; i++) {
        c->camera = whole(json_array_get(nodes, i), "camera", -1);
        if (json_object_get(item(g, "cameras", c->camera), "perspective")) at = (json_int_t)i;
    }
    if (at < 0) return damaged(g, "no node has a perspective camera");
    for (c->n = 0; at >= 0 && c->n < DEEPEST; at = parent_of(g, at)) {
        c->nodes[c->n] = item(g, "nodes", at);
        c->index[c->n++] = at;
    }
    return at < 0 ? read_camera(g, c) : damaged(g, "its nodes lie too deep in each other");
}

/* Which value of the chain a channel moves; NULL: none. */
static channel *target_of(chain *c, const json_t *target, size_t *width)
{
    static const char *const paths[] = { "translation", "rotation", "scale" };
    const char *path = json_string_value(json_object_get(target, "path"));
    const json_int_t node = whole(target, "node", -1);
    for (int i = 0; i < c->n && path; i++)
        for (int kind = PLACE; kind <= SCALE; kind++) {
            if (c->index[i] != node || strcmp(path, paths[kind]) != 0) continue;
            *width = kind == TURN ? 4 : 3;
            return &c->of[i][kind];
        }
    const json_t *pointer = json_object_get(json_object_get(target, "extensions"), "KHR_animation_pointer");
    const char *text = json_string_value(json_object_get(pointer, "pointer"));
    char wanted[64];
    snprintf(wanted, sizeof wanted, "/cameras/%lld/perspective/yfov", (long long)c->camera);
    *width = 1;
    return text && strcmp(text, wanted) == 0 ? &c->of[0][FOV] : NULL;
}

static cn_status add_channel(const glb *g, const json_t *animation, const json_t *from, chain *c)
{
    size_t width;
    channel *to = target_of(c, json_object_get(from, "target"), &width);
    if (!to || to->times.n) return CN_OK;
    const json_int_t index = whole(from, "sampler", -1);
    const json_t *sampler = index < 0 ? NULL : json_array_get(json_object_get(animation, "samplers"), (size_t)index);
    const char *way = json_string_value(json_object_get(sampler, "interpolation"));
    channel read = { .step = way && strcmp(way, "STEP") == 0, .cubic = way && strcmp(way, "CUBICSPLINE") == 0 };
    CN_TRY(rows_of(g, whole(sampler, "input", -1), &read.times));
    CN_TRY(rows_of(g, whole(sampler, "output", -1), &read.values));
    if (read.times.width != 1 || read.values.width != width || read.times.n > MOST_FRAMES ||
        read.values.n != read.times.n * (read.cubic ? 3 : 1))
        return damaged(g, "times and values of its animation do not agree");
    for (size_t i = 0; i < read.times.n; i++) {
        if (!isfinite(value_at(&read.times, i, 0)) ||
            (i && !(value_at(&read.times, i, 0) > value_at(&read.times, i - 1, 0))))
            return damaged(g, "the times of its animation do not increase");
    }
    for (size_t i = 0; i < read.values.n; i++)
        for (size_t k = 0; k < width; k++)
            if (!isfinite(value_at(&read.values, i, k)))
                return damaged(g, "its animation has a value that is no number");
    *to = read;
    return CN_OK;
}

static cn_status find_channels(const glb *g, chain *c)
{
    size_t a, i;
    json_t *animation, *one;
    json_array_foreach(json_object_get(g->root, "animations"), a, animation)
    {
        json_array_foreach(json_object_get(animation, "channels"), i, one) CN_TRY(add_channel(g, animation, one, c));
    }
    return CN_OK;
}

/* ---- the camera at a time ---- */

static void hermite(const channel *c, size_t i, double t, double span_s, size_t k, double *out)
{
    const double p = value_at(&c->values, 3 * i + 1, k), q = value_at(&c->values, 3 * i + 4, k);
    const double m = span_s * value_at(&c->values, 3 * i + 2, k), n = span_s * value_at(&c->values, 3 * i + 3, k);
    const double t2 = t * t, t3 = t2 * t;
    *out = (2 * t3 - 3 * t2 + 1) * p + (t3 - 2 * t2 + t) * m + (3 * t2 - 2 * t3) * q + (t3 - t2) * n;
}

/* The values of a channel at a time; turn: it is a quaternion x y z w. */
static void channel_at(const channel *c, double time_s, bool turn, double *out)
{
    size_t low = 0, high = c->times.n - 1;
    const size_t width = c->values.width, row = c->cubic ? 3 : 1, middle = c->cubic;
    while (high - low > 1) {
        const size_t half = (low + high) / 2;
        if (value_at(&c->times, half, 0) <= time_s)
            low = half;
        else
            high = half;
    }
    const double from = value_at(&c->times, low, 0), span = value_at(&c->times, high, 0) - from;
    double t = span > 0 ? fmin(fmax((time_s - from) / span, 0), 1) : 0;
    if (c->step) t = t < 1 ? 0 : 1;
    double a[4], b[4];
    for (size_t k = 0; k < width; k++) {
        a[k] = value_at(&c->values, row * low + middle, k);
        b[k] = value_at(&c->values, row * high + middle, k);
        out[k] = a[k] + t * (b[k] - a[k]);
        if (c->cubic && t > 0 && t < 1) hermite(c, low, t, span, k, &out[k]);
    }
    if (!turn || c->cubic) return;
    const double p[4] = { a[3], a[0], a[1], a[2] }, q[4] = { b[3], b[0], b[1], b[2] };
    double between[4];
    cn_quat_slerp(p, q, t, between);
    for (int k = 0; k < 4; k++)
        out[k] = between[(k + 1) % 4];
}

/* What a node does to its children: linear part and translation. */
static void node_at(const chain *c, int i, double time_s, double m[9], double t[3])
{
    double matrix[16], turn[4] = { 0, 0, 0, 1 }, scale[3] = { 1, 1, 1 };
    const json_t *node = c->nodes[i];
    memset(t, 0, sizeof(double[3]));
    if (list_of(node, "matrix", matrix, 16)) { /* by columns */
        for (int r = 0; r < 3; r++) {
            for (int k = 0; k < 3; k++)
                m[3 * r + k] = matrix[4 * k + r];
            t[r] = matrix[12 + r];
        }
        return;
    }
    double held[4];
    if (list_of(node, "translation", held, 3)) memcpy(t, held, sizeof(double[3]));
    if (list_of(node, "rotation", held, 4)) memcpy(turn, held, sizeof turn);
    if (list_of(node, "scale", held, 3)) memcpy(scale, held, sizeof scale);
    if (c->of[i][PLACE].times.n) channel_at(&c->of[i][PLACE], time_s, false, t);
    if (c->of[i][TURN].times.n) channel_at(&c->of[i][TURN], time_s, true, turn);
    if (c->of[i][SCALE].times.n) channel_at(&c->of[i][SCALE], time_s, false, scale);
    cn_quat_to_mat3((const double[4]){ turn[3], turn[0], turn[1], turn[2] }, m);
    for (int k = 0; k < 9; k++)
        m[k] *= scale[k % 3];
}

static cn_status sample_chain(const glb *g, const chain *c, double time_s, cn_path_sample *out)
{
    double m[9] = { 1, 0, 0, 0, 1, 0, 0, 0, 1 }, fov = c->vfov_rad;
    *out = (cn_path_sample){ .time_s = time_s };
    for (int i = 0; i < c->n; i++) { /* from the camera to the root */
        double above[9], t[3], product[9], moved[3];
        node_at(c, i, time_s, above, t);
        cn_mat3_mul(above, m, product);
        cn_mat3_vec(above, out->centre, moved);
        memcpy(m, product, sizeof m);
        for (int k = 0; k < 3; k++)
            out->centre[k] = moved[k] + t[k];
    }
    for (int a = 0; a < 3; a++) { /* what a scale leaves of the directions */
        double axis[3] = { m[a], m[3 + a], m[6 + a] };
        if (!cn_normalize3(axis)) return damaged(g, "its camera has a scale of 0");
        for (int k = 0; k < 3; k++)
            out->rotation[3 * k + a] = axis[k];
    }
    if (c->of[0][FOV].times.n) channel_at(&c->of[0][FOV], time_s, false, &fov);
    out->vfov_deg = cn_degrees(fov);
    return out->vfov_deg >= 1 && out->vfov_deg <= 170
               ? CN_OK
               : cn_fail(CN_ERR_FORMAT, "%s: a field of view of %g degrees must lie between 1 and 170", g->file,
                         out->vfov_deg);
}

/* ---- the moments at which it is sampled ---- */

typedef struct moments {
    double *time_s; /* ascending */
    size_t n;
    double fps;
} moments;

static int by_time(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

/* The channel has the times of one before it, as exports of every frame have. */
static bool repeats(const channel *list, int i)
{
    for (int k = 0; k < i; k++)
        if (list[k].times.at == list[i].times.at && list[k].times.n == list[i].times.n) return true;
    return false;
}

static void sort_out(moments *m)
{
    size_t n = 0;
    qsort(m->time_s, m->n, sizeof *m->time_s, by_time);
    for (size_t i = 0; i < m->n; i++)
        if (n == 0 || m->time_s[i] > m->time_s[n - 1]) m->time_s[n++] = m->time_s[i];
    m->n = n;
}

/* The keys of all channels. The caller frees them. */
static cn_status gather_keys(const glb *g, const chain *c, moments *m)
{
    const channel *list = c->of[0];
    const int n = c->n * KINDS;
    size_t total = 0;
    for (int i = 0; i < n; i++)
        if (!repeats(list, i)) total += list[i].times.n;
    if (total > MOST_FRAMES) return damaged(g, "its animation has more than a million keys");
    m->time_s = malloc((total + 1) * sizeof *m->time_s);
    if (!m->time_s) return cn_fail(CN_ERR_NOMEM, "out of memory for the %zu keys of %s", total, g->file);
    for (int i = 0; i < n; i++)
        for (size_t k = 0; k < list[i].times.n && !repeats(list, i); k++)
            m->time_s[m->n++] = value_at(&list[i].times, k, 0);
    if (m->n == 0) m->time_s[m->n++] = 0; /* nothing moves */
    sort_out(m);
    return CN_OK;
}

/* A film has at least so many frames a second. Keys that are farther apart were set by hand. */
#define LEAST_FPS 10.0

/* Frames per second of keys that are evenly spaced, one for each frame; else 0. */
static double rate_of(const moments *m)
{
    if (m->n < 2) return 0;
    const double step = (m->time_s[m->n - 1] - m->time_s[0]) / (double)(m->n - 1);
    for (size_t i = 1; i < m->n; i++)
        if (fabs(m->time_s[i] - m->time_s[i - 1] - step) > 0.01 * step) return 0;
    const double rate = 1 / step, nearest = round(rate);
    if (rate < 0.99 * LEAST_FPS) return 0;
    return fabs(rate - nearest) < 1e-3 * nearest ? nearest : rate;
}

/* A moment for each frame between the keys: the camera need not go straight from key to key. */
static cn_status add_frames(const glb *g, uint32_t n_frames, moments *m)
{
    const double first = m->time_s[0], duration_s = m->time_s[m->n - 1] - first, apart_s = 1e-4 / m->fps;
    const double wanted = fmin(round(duration_s * m->fps), n_frames ? n_frames * 4.0 : INFINITY);
    if (wanted > MOST_FRAMES) return CN_OK; /* cn_path_start refuses so many */
    const size_t frames = (size_t)wanted, n_keys = m->n;
    double *more = realloc(m->time_s, (n_keys + frames + 1) * sizeof *more);
    if (!more) return cn_fail(CN_ERR_NOMEM, "out of memory for the %zu frames of %s", frames, g->file);
    m->time_s = more;
    for (size_t i = 1, key = 0; i < frames; i++) {
        const double time_s = first + (double)i * duration_s / (double)frames;
        while (key + 2 < n_keys && more[key + 1] <= time_s)
            key++;
        if (time_s - more[key] > apart_s && more[key + 1] - time_s > apart_s) more[m->n++] = time_s;
    }
    sort_out(m);
    return CN_OK;
}

static cn_status read_path(const glb *g, chain *c, const cn_path_options *options, cn_path *path)
{
    moments m = { 0 };
    CN_TRY(find_chain(g, c));
    CN_TRY(find_channels(g, c));
    cn_status status = gather_keys(g, c, &m);
    if (status == CN_OK && (m.fps = rate_of(&m)) == 0) {
        m.fps = options->fps > 0 ? options->fps : 24;
        status = add_frames(g, options->n_frames, &m);
    }
    cn_path_sample *samples = status == CN_OK ? calloc(m.n, sizeof *samples) : NULL;
    if (status == CN_OK && !samples)
        status = cn_fail(CN_ERR_NOMEM, "out of memory for the %zu frames of %s", m.n, g->file);
    for (size_t i = 0; i < m.n && status == CN_OK; i++)
        status = sample_chain(g, c, m.time_s[i], &samples[i]);
    if (status == CN_OK) status = cn_path_from_samples(path, g->file, samples, m.n, m.fps, options);
    free(samples);
    free(m.time_s);
    return status;
}

cn_status cn_path_from_gltf(cn_path *path, const char *file, const cn_path_options *options)
{
    glb g = { .file = file };
    chain *c = calloc(1, sizeof *c);
    cn_status status = c ? open_glb(&g) : cn_fail(CN_ERR_NOMEM, "out of memory for %s", file);
    if (status == CN_OK) status = read_path(&g, c, options, path);
    close_glb(&g);
    free(c);
    return status;
}
