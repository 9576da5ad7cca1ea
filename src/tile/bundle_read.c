/* Reads a safetensors file. The header is not trusted: every size is checked against the file before use. */
#include "base/hash.h"
#include "tile/bundle.h"

#include <errno.h>
#include <fcntl.h>
#include <jansson.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

/* A tensor as the header places it in the data section. */
typedef struct placed {
    cn_tensor tensor;
    uint64_t begin, end;
} placed;

/* Maps the whole file. Fails when it is not a regular file, or too short for a header. */
static cn_status map_file(cn_bundle *bundle, const char *path)
{
    int fd = open(path, O_RDONLY | O_CLOEXEC);
    if (fd < 0) return cn_fail(CN_ERR_IO, "%s: cannot be opened: %s", path, strerror(errno));
    struct stat info;
    if (fstat(fd, &info) != 0 || !S_ISREG(info.st_mode)) {
        close(fd);
        return cn_fail(CN_ERR_IO, "%s: is not a regular file", path);
    }
    if (info.st_size < 10) {
        close(fd);
        return cn_fail(CN_ERR_FORMAT, "%s: %lld bytes are too few for a safetensors file", path,
                       (long long)info.st_size);
    }
    void *map = mmap(NULL, (size_t)info.st_size, PROT_READ, MAP_PRIVATE, fd, 0);
    int cause = errno;
    close(fd);
    if (map == MAP_FAILED) return cn_fail(CN_ERR_IO, "%s: cannot be mapped: %s", path, strerror(cause));
    bundle->map = map;
    bundle->map_size = (size_t)info.st_size;
    return CN_OK;
}

static cn_status parse_header(const cn_bundle *bundle, const char *path, json_t **root, uint64_t *data_start)
{
    uint64_t length;
    memcpy(&length, bundle->map, sizeof length);
    if (length > CN_BUNDLE_HEADER_MAX)
        return cn_fail(CN_ERR_FORMAT, "%s: says that its header has %llu bytes; the format allows at most 100 MiB",
                       path, (unsigned long long)length);
    if (length > bundle->map_size - 8)
        return cn_fail(CN_ERR_FORMAT, "%s: the header has %llu bytes but the file only %zu; the file is truncated",
                       path, (unsigned long long)length, bundle->map_size);
    const char *text = (const char *)bundle->map + 8;
    if (length < 2 || text[0] != '{')
        return cn_fail(CN_ERR_FORMAT, "%s: the header does not begin with '{'; not a safetensors file", path);
    json_error_t error;
    *root = json_loadb(text, length, JSON_REJECT_DUPLICATES, &error);
    if (!*root)
        return cn_fail(CN_ERR_FORMAT, "%s: the header is not valid JSON at byte %d: %s", path, 8 + error.position,
                       error.text);
    *data_start = 8 + length;
    return CN_OK;
}

static cn_status read_metadata(cn_bundle *bundle, const char *path, json_t *object)
{
    if (!json_is_object(object)) return cn_fail(CN_ERR_FORMAT, "%s: __metadata__ is not an object", path);
    if (json_object_size(object) > CN_BUNDLE_PAIRS_MAX)
        return cn_fail(CN_ERR_FORMAT, "%s: more than %d metadata strings", path, CN_BUNDLE_PAIRS_MAX);
    const char *key;
    json_t *value;
    json_object_foreach(object, key, value)
    {
        if (!json_is_string(value)) return cn_fail(CN_ERR_FORMAT, "%s: metadata '%.80s' is not a string", path, key);
        CN_TRY(cn_bundle_set(bundle, key, json_string_value(value)));
    }
    return CN_OK;
}

/* A whole number >= 0. */
static bool whole_number(const json_t *value, uint64_t *out)
{
    if (!json_is_integer(value) || json_integer_value(value) < 0) return false;
    *out = (uint64_t)json_integer_value(value);
    return true;
}

static cn_status read_tensor(const char *path, const char *name, const json_t *object, uint64_t data_size, placed *out)
{
    if (!name[0] || strlen(name) >= sizeof out->tensor.name)
        return cn_fail(CN_ERR_FORMAT, "%s: tensor name '%.80s' must have 1 to 63 characters", path, name);
    const json_t *dtype = json_object_get(object, "dtype"), *shape = json_object_get(object, "shape");
    const json_t *offsets = json_object_get(object, "data_offsets");
    if (!json_is_object(object) || json_object_size(object) != 3 || !json_is_string(dtype) || !json_is_array(shape) ||
        !json_is_array(offsets) || json_array_size(offsets) != 2)
        return cn_fail(CN_ERR_FORMAT, "%s: tensor '%s' must have exactly dtype, shape and data_offsets", path, name);
    if (!cn_dtype_from_name(json_string_value(dtype), &out->tensor.dtype))
        return cn_fail(CN_ERR_FORMAT, "%s: tensor '%s' has type '%.40s', which Conurb does not read", path, name,
                       json_string_value(dtype));
    if (json_array_size(shape) > CN_BUNDLE_DIMS_MAX)
        return cn_fail(CN_ERR_FORMAT, "%s: tensor '%s' has %zu dimensions; at most 4 are read", path, name,
                       json_array_size(shape));
    memcpy(out->tensor.name, name, strlen(name));
    out->tensor.n_dims = (uint32_t)json_array_size(shape);
    for (uint32_t i = 0; i < out->tensor.n_dims; i++)
        if (!whole_number(json_array_get(shape, i), &out->tensor.dims[i]))
            return cn_fail(CN_ERR_FORMAT, "%s: tensor '%s' has a shape that is not whole numbers", path, name);
    uint64_t bytes;
    if (!cn_tensor_bytes(&out->tensor, &bytes))
        return cn_fail(CN_ERR_FORMAT, "%s: the shape of tensor '%s' overflows", path, name);
    if (!whole_number(json_array_get(offsets, 0), &out->begin) ||
        !whole_number(json_array_get(offsets, 1), &out->end) || out->begin > out->end || out->end > data_size)
        return cn_fail(CN_ERR_FORMAT, "%s: tensor '%s' lies outside the file, which is damaged or cut short", path,
                       name);
    if (out->end - out->begin != bytes)
        return cn_fail(CN_ERR_FORMAT, "%s: tensor '%s' has %llu bytes but its shape needs %llu", path, name,
                       (unsigned long long)(out->end - out->begin), (unsigned long long)bytes);
    return CN_OK;
}

static int by_place(const void *a, const void *b)
{
    const placed *p = a, *q = b;
    if (p->begin != q->begin) return p->begin < q->begin ? -1 : 1;
    if (p->end != q->end) return p->end < q->end ? -1 : 1;
    return strcmp(p->tensor.name, q->tensor.name);
}

/* A pointer to the tensor's bytes, aligned for its type. Copies them when they are not aligned in the file. */
static cn_status point_at(cn_bundle *bundle, const char *path, const unsigned char *data, const placed *p)
{
    cn_tensor tensor = p->tensor;
    tensor.data = data + p->begin;
    if ((uintptr_t)tensor.data % cn_dtype_size(tensor.dtype) != 0) {
        void **more = realloc(bundle->copies, (bundle->n_copies + 1) * sizeof *more);
        if (more) bundle->copies = more;
        void *copy = more ? malloc(p->end - p->begin + 1) : NULL;
        if (!copy) return cn_fail(CN_ERR_NOMEM, "%s: out of memory for tensor '%s'", path, tensor.name);
        memcpy(copy, tensor.data, p->end - p->begin);
        bundle->copies[bundle->n_copies++] = copy;
        tensor.data = copy;
    }
    bundle->tensors[bundle->n_tensors++] = tensor;
    return CN_OK;
}

/* Sorts tensors by offset and checks that they fill the data section without gaps or overlaps. */
static cn_status place_tensors(cn_bundle *bundle, const char *path, placed *items, size_t n, uint64_t data_start)
{
    qsort(items, n, sizeof *items, by_place);
    uint64_t at = 0;
    for (size_t i = 0; i < n; i++) {
        if (items[i].begin != at)
            return cn_fail(CN_ERR_FORMAT, "%s: tensor '%s' %s", path, items[i].tensor.name,
                           items[i].begin < at ? "overlaps the one before it" : "has a gap before it");
        at = items[i].end;
    }
    if (at != bundle->map_size - data_start)
        return cn_fail(CN_ERR_FORMAT, "%s: %llu bytes of data, but the tensors take %llu", path,
                       (unsigned long long)(bundle->map_size - data_start), (unsigned long long)at);
    bundle->tensors = calloc(n + 1, sizeof *bundle->tensors);
    if (!bundle->tensors) return cn_fail(CN_ERR_NOMEM, "%s: out of memory for %zu tensors", path, n);
    bundle->tensor_room = (uint32_t)(n + 1);
    for (size_t i = 0; i < n; i++)
        CN_TRY(point_at(bundle, path, (const unsigned char *)bundle->map + data_start, &items[i]));
    return CN_OK;
}

static cn_status read_header(cn_bundle *bundle, const char *path, json_t *root, uint64_t data_start)
{
    if (json_object_size(root) > CN_BUNDLE_TENSORS_MAX)
        return cn_fail(CN_ERR_FORMAT, "%s: more than %d tensors", path, CN_BUNDLE_TENSORS_MAX);
    placed *items = calloc(json_object_size(root) + 1, sizeof *items);
    if (!items) return cn_fail(CN_ERR_NOMEM, "%s: out of memory for its header", path);
    cn_status status = CN_OK;
    size_t n = 0;
    const char *key;
    json_t *value;
    json_object_foreach(root, key, value)
    {
        if (strcmp(key, "__metadata__") == 0)
            status = read_metadata(bundle, path, value);
        else
            status = read_tensor(path, key, value, bundle->map_size - data_start, &items[n++]);
        if (status != CN_OK) break;
    }
    if (status == CN_OK) status = place_tensors(bundle, path, items, n, data_start);
    free(items);
    return status;
}

static cn_status check_sum(const cn_bundle *bundle, const char *path, uint64_t data_start)
{
    const char *expected = cn_bundle_get(bundle, CN_BUNDLE_CHECKSUM);
    if (!expected) return CN_OK;
    char hex[17];
    cn_hash_hex(cn_hash64((const unsigned char *)bundle->map + data_start, bundle->map_size - data_start), hex);
    if (strcmp(hex, expected) != 0)
        return cn_fail(CN_ERR_FORMAT,
                       "%s: its data do not match its checksum: the file is damaged; remove it and run again", path);
    return CN_OK;
}

cn_status cn_bundle_open(cn_bundle **bundle, const char *path, bool verify)
{
    CN_TRY(cn_bundle_create(bundle));
    json_t *root = NULL;
    uint64_t data_start = 0;
    cn_status status = map_file(*bundle, path);
    if (status == CN_OK) status = parse_header(*bundle, path, &root, &data_start);
    if (status == CN_OK) status = read_header(*bundle, path, root, data_start);
    if (status == CN_OK && verify) status = check_sum(*bundle, path, data_start);
    json_decref(root);
    if (status != CN_OK) cn_bundle_destroy(bundle);
    return status;
}
