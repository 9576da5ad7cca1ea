#include "train/checkpoint.h"

#include <string.h>

void cn_checkpoint_add(cn_checkpoint *c, const char *name, cn_dtype dtype, size_t n, void *data)
{
    if (n) c->array[c->n++] = (cn_checkpoint_array){ .name = name, .dtype = dtype, .n = n, .data = data };
}

cn_status cn_checkpoint_save(const cn_checkpoint *c, const char *key, const char *path)
{
    cn_bundle *bundle = NULL;
    CN_TRY(cn_bundle_create(&bundle));
    cn_status status = CN_OK;
    for (uint32_t i = 0; i < c->n && status == CN_OK; i++) {
        const cn_checkpoint_array *a = &c->array[i];
        const uint64_t dims[1] = { a->n };
        status = cn_bundle_add(bundle, a->name, a->dtype, 1, dims, a->data);
    }
    if (status == CN_OK) status = cn_bundle_set(bundle, "conurb.checkpoint", key);
    if (status == CN_OK) status = cn_bundle_write(bundle, path);
    cn_bundle_destroy(&bundle);
    return status;
}

static const void *find(const cn_bundle *bundle, const cn_checkpoint_array *a)
{
    const cn_tensor *tensor = cn_bundle_find(bundle, a->name);
    if (!tensor || tensor->dtype != a->dtype || tensor->n_dims != 1 || tensor->dims[0] != a->n) return NULL;
    return !a->valid || a->valid(tensor->data) ? tensor->data : NULL;
}

static cn_status restore(const cn_checkpoint *c, const cn_bundle *bundle, const char *path)
{
    for (uint32_t i = 0; i < c->n; i++)
        if (!find(bundle, &c->array[i]))
            return cn_fail(CN_ERR_FORMAT, "%s is damaged; delete it to train from the start", path);
    for (uint32_t i = 0; i < c->n; i++) {
        const cn_checkpoint_array *a = &c->array[i];
        memcpy(a->data, find(bundle, a), a->n * cn_dtype_size(a->dtype));
    }
    return CN_OK;
}

cn_status cn_checkpoint_load(const cn_checkpoint *c, const char *key, const char *path, bool *loaded)
{
    *loaded = false;
    cn_bundle *bundle = NULL;
    CN_TRY(cn_bundle_open(&bundle, path, true));
    const char *made_with = cn_bundle_get(bundle, "conurb.checkpoint");
    cn_status status = CN_OK;
    if (made_with && strcmp(made_with, key) == 0) {
        status = restore(c, bundle, path);
        *loaded = status == CN_OK;
    }
    cn_bundle_destroy(&bundle);
    return status;
}
