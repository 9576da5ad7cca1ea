/* A bundle in memory: a list of tensors and a list of string pairs. */
#include "tile/bundle.h"

#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>

static const struct {
    const char *name;
    size_t size;
} dtypes[] = {
    [CN_F32] = { "F32", 4 }, [CN_BF16] = { "BF16", 2 }, [CN_F16] = { "F16", 2 }, [CN_U8] = { "U8", 1 },
    [CN_U32] = { "U32", 4 }, [CN_U64] = { "U64", 8 },   [CN_F64] = { "F64", 8 },
};
#define N_DTYPES (sizeof dtypes / sizeof dtypes[0])

size_t cn_dtype_size(cn_dtype dtype)
{
    return (size_t)dtype < N_DTYPES ? dtypes[dtype].size : 0;
}

const char *cn_dtype_name(cn_dtype dtype)
{
    return (size_t)dtype < N_DTYPES ? dtypes[dtype].name : "?";
}

bool cn_dtype_from_name(const char *name, cn_dtype *dtype)
{
    for (size_t i = 0; i < N_DTYPES; i++) {
        if (strcmp(name, dtypes[i].name) == 0) {
            *dtype = (cn_dtype)i;
            return true;
        }
    }
    return false;
}

bool cn_tensor_bytes(const cn_tensor *tensor, uint64_t *bytes)
{
    uint64_t n = cn_dtype_size(tensor->dtype);
    for (uint32_t i = 0; i < tensor->n_dims; i++)
        if (__builtin_mul_overflow(n, tensor->dims[i], &n)) return false;
    *bytes = n;
    return n <= (uint64_t)INT64_MAX;
}

cn_status cn_bundle_create(cn_bundle **bundle)
{
    *bundle = calloc(1, sizeof **bundle);
    return *bundle ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory for a tile file's header");
}

void cn_bundle_destroy(cn_bundle **bundle)
{
    cn_bundle *b = *bundle;
    if (!b) return;
    for (uint32_t i = 0; i < b->n_pairs; i++) {
        free(b->pairs[i].key);
        free(b->pairs[i].value);
    }
    for (uint32_t i = 0; i < b->n_copies; i++)
        free(b->copies[i]);
    if (b->map) munmap(b->map, b->map_size);
    free(b->copies);
    free(b->pairs);
    free(b->tensors);
    free(b);
    *bundle = NULL;
}

/* Makes room for one more item in an array that doubles. */
static cn_status grow(void **items, uint32_t n, uint32_t *room, size_t size)
{
    if (n < *room) return CN_OK;
    uint32_t more = *room ? *room * 2 : 16;
    void *grown = realloc(*items, more * size);
    if (!grown) return cn_fail(CN_ERR_NOMEM, "out of memory for a tile file's header");
    *items = grown;
    *room = more;
    return CN_OK;
}

cn_status cn_bundle_add(cn_bundle *bundle, const char *name, cn_dtype dtype, uint32_t n_dims, const uint64_t *dims,
                        const void *data)
{
    if (!name[0] || strlen(name) >= sizeof bundle->tensors->name || strcmp(name, "__metadata__") == 0)
        return cn_fail(CN_ERR_USAGE, "tensor name '%.80s' must have 1 to 63 characters and not be __metadata__", name);
    if (n_dims > CN_BUNDLE_DIMS_MAX || !cn_dtype_size(dtype))
        return cn_fail(CN_ERR_USAGE, "tensor '%s': %u dimensions, type %d: at most 4 dimensions of a known type", name,
                       n_dims, (int)dtype);
    if (cn_bundle_find(bundle, name)) return cn_fail(CN_ERR_USAGE, "tensor '%s' is there twice", name);
    cn_tensor tensor = { .dtype = dtype, .n_dims = n_dims, .data = data };
    memcpy(tensor.name, name, strlen(name));
    for (uint32_t i = 0; i < n_dims; i++)
        tensor.dims[i] = dims[i];
    uint64_t bytes;
    if (!cn_tensor_bytes(&tensor, &bytes)) return cn_fail(CN_ERR_USAGE, "tensor '%s' is too large to count", name);
    CN_TRY(grow((void **)&bundle->tensors, bundle->n_tensors, &bundle->tensor_room, sizeof *bundle->tensors));
    bundle->tensors[bundle->n_tensors++] = tensor;
    return CN_OK;
}

cn_status cn_bundle_set(cn_bundle *bundle, const char *key, const char *value)
{
    char *copy = strdup(value);
    if (!copy) return cn_fail(CN_ERR_NOMEM, "out of memory for metadata '%s'", key);
    for (uint32_t i = 0; i < bundle->n_pairs; i++) {
        if (strcmp(bundle->pairs[i].key, key) == 0) {
            free(bundle->pairs[i].value);
            bundle->pairs[i].value = copy;
            return CN_OK;
        }
    }
    char *name = strdup(key);
    if (!name || grow((void **)&bundle->pairs, bundle->n_pairs, &bundle->pair_room, sizeof *bundle->pairs) != CN_OK) {
        free(name);
        free(copy);
        return cn_fail(CN_ERR_NOMEM, "out of memory for metadata '%s'", key);
    }
    bundle->pairs[bundle->n_pairs++] = (cn_bundle_pair){ name, copy };
    return CN_OK;
}

uint32_t cn_bundle_count(const cn_bundle *bundle)
{
    return bundle->n_tensors;
}

const cn_tensor *cn_bundle_at(const cn_bundle *bundle, uint32_t i)
{
    return i < bundle->n_tensors ? &bundle->tensors[i] : NULL;
}

const cn_tensor *cn_bundle_find(const cn_bundle *bundle, const char *name)
{
    for (uint32_t i = 0; i < bundle->n_tensors; i++)
        if (strcmp(bundle->tensors[i].name, name) == 0) return &bundle->tensors[i];
    return NULL;
}

const char *cn_bundle_get(const cn_bundle *bundle, const char *key)
{
    for (uint32_t i = 0; i < bundle->n_pairs; i++)
        if (strcmp(bundle->pairs[i].key, key) == 0) return bundle->pairs[i].value;
    return NULL;
}
