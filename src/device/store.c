#include "device/store.h"

#include <stdlib.h>

enum { KEPT_PART = 4 /* fields that nobody uses have a quarter of the device's memory, at most */ };

typedef struct kept_pipelines {
    cn_tracer_sizes sizes;
    cn_tracer_pipelines pipelines;
    struct kept_pipelines *next;
} kept_pipelines;

typedef struct cn_tracer_store {
    pthread_mutex_t lock;
    cn_stored_field *fields;
    kept_pipelines *pipelines;
    uint64_t clock;
} store;

/* The device's store, made at its first use. */
static store *store_of(cn_vulkan *device)
{
    pthread_mutex_lock(&device->lock);
    if (!device->store && (device->store = calloc(1, sizeof *device->store))) {
        pthread_mutex_init(&device->store->lock, NULL);
        device->trim = cn_tracer_store_trim;
    }
    store *s = device->store;
    pthread_mutex_unlock(&device->lock);
    return s;
}

static size_t table_bytes(const cn_device_field *f)
{
    return f->entries * sizeof *f->table;
}
static size_t weights_bytes(const cn_device_field *f)
{
    return (f->n_weights + CN_STORE_WEIGHTS_PAST_END) * sizeof *f->weights;
}
static uint64_t stored_bytes(const cn_stored_field *f)
{
    return f->table.size + f->weights.size;
}
uint64_t cn_tracer_store_bytes(const cn_device_field *f)
{
    return table_bytes(f) + weights_bytes(f);
}

static void destroy_field(cn_vulkan *device, cn_stored_field *f)
{
    cn_device_buffer_destroy(device, &f->table);
    cn_device_buffer_destroy(device, &f->weights);
    free(f);
}

/* Under the lock. Frees fields that nobody uses, the longest unused first, until the others have this many bytes. */
static bool trim(cn_vulkan *device, store *s, uint64_t bytes)
{
    bool freed = false;
    for (;;) {
        cn_stored_field **oldest = NULL, *f;
        uint64_t idle = 0;
        for (cn_stored_field **at = &s->fields; *at; at = &(*at)->next) {
            if ((*at)->users) continue;
            idle += stored_bytes(*at);
            if (!oldest || (*at)->used < (*oldest)->used) oldest = at;
        }
        if (!oldest || idle <= bytes) return freed;
        f = *oldest;
        *oldest = f->next;
        destroy_field(device, f);
        freed = true;
    }
}

static cn_status send(cn_device_stream *stream, const cn_device_field *from, cn_stored_field *to)
{
    const float zero[CN_STORE_WEIGHTS_PAST_END] = { 0 };
    const size_t weights = from->n_weights * sizeof *from->weights;
    CN_TRY(cn_device_buffer_create(stream->device, table_bytes(from), false, &to->table));
    CN_TRY(cn_device_buffer_create(stream->device, weights_bytes(from), false, &to->weights));
    CN_TRY(cn_device_put(stream, &to->table, 0, from->table, table_bytes(from)));
    CN_TRY(cn_device_put(stream, &to->weights, 0, from->weights, weights));
    return cn_device_put(stream, &to->weights, weights, zero, sizeof zero);
}

static cn_status send_new(cn_device_stream *stream, const cn_device_field *field, cn_stored_field **out)
{
    *out = calloc(1, sizeof **out);
    if (!*out) return cn_fail(CN_ERR_NOMEM, "out of memory");
    (*out)->serial = field->serial;
    const cn_status status = send(stream, field, *out);
    if (status == CN_OK) return CN_OK;
    destroy_field(stream->device, *out);
    *out = NULL;
    return status;
}

/* Under the lock. */
static cn_status find_or_send(store *s, cn_device_stream *stream, const cn_device_field *field, cn_stored_field **out)
{
    for (*out = s->fields; *out; *out = (*out)->next)
        if (field->serial && (*out)->serial == field->serial) return CN_OK;
    cn_status status = send_new(stream, field, out);
    if (status == CN_ERR_NOMEM && trim(stream->device, s, 0)) status = send_new(stream, field, out);
    if (status != CN_OK) return status;
    (*out)->next = s->fields;
    s->fields = *out;
    return CN_OK;
}

cn_status cn_tracer_store_field(cn_device_stream *stream, const cn_device_field *field, cn_stored_field **out)
{
    store *s = store_of(stream->device);
    *out = NULL;
    if (!s) return cn_fail(CN_ERR_NOMEM, "out of memory");
    pthread_mutex_lock(&s->lock);
    const cn_status status = find_or_send(s, stream, field, out);
    if (status == CN_OK) {
        (*out)->users++;
        (*out)->used = ++s->clock;
    }
    pthread_mutex_unlock(&s->lock);
    return status;
}

/* A field without a serial is nobody else's. */
void cn_tracer_store_give_back(cn_vulkan *device, cn_stored_field **stored)
{
    store *s = device->store;
    cn_stored_field *f = *stored;
    *stored = NULL;
    if (!f) return;
    pthread_mutex_lock(&s->lock);
    f->users--;
    if (!f->serial) {
        cn_stored_field **at = &s->fields;
        while (*at != f)
            at = &(*at)->next;
        *at = f->next;
        destroy_field(device, f);
    }
    (void)trim(device, s, device->base.info.bytes / KEPT_PART);
    pthread_mutex_unlock(&s->lock);
}

bool cn_tracer_store_trim(cn_vulkan *device)
{
    store *s = device->store;
    if (!s || pthread_mutex_trylock(&s->lock) != 0) return false;
    const bool freed = trim(device, s, 0);
    pthread_mutex_unlock(&s->lock);
    return freed;
}

static bool same_sizes(const cn_tracer_sizes *a, const cn_tracer_sizes *b)
{
    return a->lanes == b->lanes && a->rows == b->rows && a->round == b->round;
}

/* Under the lock. */
static cn_status find_or_compile(cn_vulkan *device, store *s, const cn_tracer_sizes *sizes, kept_pipelines **out)
{
    for (*out = s->pipelines; *out; *out = (*out)->next)
        if (same_sizes(&(*out)->sizes, sizes)) return CN_OK;
    kept_pipelines *p = calloc(1, sizeof *p);
    if (!p) return cn_fail(CN_ERR_NOMEM, "out of memory");
    const cn_status status = cn_tracer_pipelines_create(device, sizes, &p->pipelines);
    if (status != CN_OK) {
        cn_tracer_pipelines_destroy(device, &p->pipelines);
        free(p);
        return status;
    }
    p->sizes = *sizes;
    p->next = s->pipelines;
    s->pipelines = *out = p;
    return CN_OK;
}

cn_status cn_tracer_store_pipelines(cn_vulkan *device, const cn_tracer_sizes *sizes, const cn_tracer_pipelines **out)
{
    store *s = store_of(device);
    kept_pipelines *p;
    if (!s) return cn_fail(CN_ERR_NOMEM, "out of memory");
    pthread_mutex_lock(&s->lock);
    const cn_status status = find_or_compile(device, s, sizes, &p);
    if (status == CN_OK) *out = &p->pipelines;
    pthread_mutex_unlock(&s->lock);
    return status;
}

void cn_tracer_store_close(cn_vulkan *device)
{
    store *s = device->store;
    if (!s) return;
    for (cn_stored_field *f = s->fields, *next; f; f = next) {
        next = f->next;
        destroy_field(device, f);
    }
    for (kept_pipelines *p = s->pipelines, *next; p; p = next) {
        next = p->next;
        cn_tracer_pipelines_destroy(device, &p->pipelines);
        free(p);
    }
    pthread_mutex_destroy(&s->lock);
    free(s);
    device->store = NULL;
}
