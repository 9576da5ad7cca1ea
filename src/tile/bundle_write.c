/* Writes a safetensors file: u64 header length, JSON header padded with spaces to 64 bytes, tensors.
 *
 * The format forbids gaps between tensors, so they cannot all be aligned to 64 bytes. They are ordered by falling
 * element size: each is then aligned to its elements, which is enough for a mapped file. */
#include "base/file.h"
#include "base/hash.h"
#include "tile/bundle.h"

#include <jansson.h>
#include <stdlib.h>
#include <string.h>
#include <xxhash.h>

#if __BYTE_ORDER__ != __ORDER_LITTLE_ENDIAN__
#error "safetensors files are little-endian; tensors are written as they lie in memory"
#endif

static int by_key(const void *a, const void *b)
{
    return strcmp((*(const cn_bundle_pair *const *)a)->key, (*(const cn_bundle_pair *const *)b)->key);
}

/* Orders tensors by falling element size; equal ones as they were added. */
static const cn_tensor **layout(const cn_bundle *bundle)
{
    const cn_tensor **order = malloc((bundle->n_tensors + 1) * sizeof *order);
    if (!order) return NULL;
    uint32_t n = 0;
    for (size_t size = 8; size > 0; size /= 2)
        for (uint32_t i = 0; i < bundle->n_tensors; i++)
            if (cn_dtype_size(bundle->tensors[i].dtype) == size) order[n++] = &bundle->tensors[i];
    return order;
}

static json_t *metadata(const cn_bundle *bundle, const char *checksum)
{
    const cn_bundle_pair own = { (char *)CN_BUNDLE_CHECKSUM, (char *)checksum };
    const cn_bundle_pair **sorted = malloc((bundle->n_pairs + 1) * sizeof *sorted);
    json_t *object = json_object();
    if (!sorted || !object) goto failed;
    uint32_t n = 0;
    for (uint32_t i = 0; i < bundle->n_pairs; i++)
        if (strcmp(bundle->pairs[i].key, CN_BUNDLE_CHECKSUM) != 0) sorted[n++] = &bundle->pairs[i];
    sorted[n++] = &own;
    qsort(sorted, n, sizeof *sorted, by_key);
    for (uint32_t i = 0; i < n; i++)
        if (json_object_set_new(object, sorted[i]->key, json_string(sorted[i]->value)) != 0) goto failed;
    free(sorted);
    return object;
failed:
    free(sorted);
    json_decref(object);
    return NULL;
}

static json_t *describe(const cn_tensor *tensor, uint64_t begin, uint64_t bytes)
{
    json_t *shape = json_array();
    for (uint32_t i = 0; i < tensor->n_dims; i++)
        json_array_append_new(shape, json_integer((json_int_t)tensor->dims[i]));
    return json_pack("{s:s, s:o, s:[I, I]}", "dtype", cn_dtype_name(tensor->dtype), "shape", shape, "data_offsets",
                     (json_int_t)begin, (json_int_t)(begin + bytes));
}

/* The JSON text; caller frees. NULL when out of memory or when a string is not UTF-8. */
static char *header_text(const cn_bundle *bundle, const cn_tensor *const *order, const char *checksum)
{
    json_t *root = json_object();
    json_t *pairs = metadata(bundle, checksum);
    bool whole = pairs && json_object_set_new(root, "__metadata__", pairs) == 0;
    uint64_t begin = 0, bytes = 0;
    for (uint32_t i = 0; whole && i < bundle->n_tensors; i++, begin += bytes)
        whole = cn_tensor_bytes(order[i], &bytes) && bytes <= (uint64_t)INT64_MAX - begin &&
                json_object_set_new(root, order[i]->name, describe(order[i], begin, bytes)) == 0;
    char *text = whole ? json_dumps(root, JSON_COMPACT) : NULL;
    json_decref(root);
    return text;
}

static cn_status checksum_of(const cn_tensor *const *order, uint32_t n, char hex[17])
{
    XXH3_state_t *state = XXH3_createState();
    if (!state) return cn_fail(CN_ERR_NOMEM, "out of memory for a checksum");
    XXH3_64bits_reset(state);
    for (uint32_t i = 0; i < n; i++) {
        uint64_t bytes;
        if (cn_tensor_bytes(order[i], &bytes) && bytes) XXH3_64bits_update(state, order[i]->data, bytes);
    }
    cn_hash_hex(XXH3_64bits_digest(state), hex);
    XXH3_freeState(state);
    return CN_OK;
}

static bool put(FILE *stream, const void *data, uint64_t bytes)
{
    return bytes == 0 || fwrite(data, 1, bytes, stream) == bytes;
}

static cn_status write_to(cn_writer *writer, const cn_tensor *const *order, uint32_t n, const char *text)
{
    uint64_t length = strlen(text);
    uint64_t padded = (length + 8 + CN_BUNDLE_ALIGN - 1) / CN_BUNDLE_ALIGN * CN_BUNDLE_ALIGN - 8;
    if (padded > CN_BUNDLE_HEADER_MAX)
        return cn_fail(CN_ERR_USAGE, "%s: a header of %llu bytes is more than the format allows", writer->path,
                       (unsigned long long)padded);
    bool whole = put(writer->stream, &padded, sizeof padded) && put(writer->stream, text, length);
    for (uint64_t i = length; whole && i < padded; i++)
        whole = fputc(' ', writer->stream) != EOF;
    for (uint32_t i = 0; whole && i < n; i++) {
        uint64_t bytes;
        whole = cn_tensor_bytes(order[i], &bytes) && put(writer->stream, order[i]->data, bytes);
    }
    return whole ? CN_OK : cn_fail(CN_ERR_IO, "%s: cannot be written; is the disk full?", writer->path);
}

cn_status cn_bundle_write(const cn_bundle *bundle, const char *path)
{
    const cn_tensor **order = layout(bundle);
    char *text = NULL, checksum[17];
    cn_writer writer = { 0 };
    cn_status status = order ? CN_OK : cn_fail(CN_ERR_NOMEM, "%s: out of memory", path);
    if (status == CN_OK) status = checksum_of(order, bundle->n_tensors, checksum);
    if (status == CN_OK && !(text = header_text(bundle, order, checksum)))
        status = cn_fail(CN_ERR_USAGE, "%s: the header cannot be made: a name or a value is not UTF-8", path);
    if (status == CN_OK) status = cn_writer_open(&writer, path);
    if (status == CN_OK) status = write_to(&writer, order, bundle->n_tensors, text);
    if (status == CN_OK) status = cn_writer_commit(&writer);
    cn_writer_abort(&writer);
    free(text);
    free(order);
    return status;
}
