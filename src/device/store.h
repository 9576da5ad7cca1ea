/* What a Vulkan device keeps between two traces: compiled pipelines, and the fields of open tiles, so that the next
 * picture of the same tiles sends none of it again. Any thread. */
#ifndef CONURB_DEVICE_STORE_H
#define CONURB_DEVICE_STORE_H
#include "device/pipeline.h"

enum { CN_STORE_WEIGHTS_PAST_END = 16 /* zeros: shaders read rows in groups */ };

/* A field on the device. */
typedef struct cn_stored_field {
    uint64_t serial, used; /* cn_device_field.serial; when it was last asked for */
    uint32_t users;
    cn_device_buffer table, weights;
    struct cn_stored_field *next;
} cn_stored_field;

/* Bytes of a field on the device. */
uint64_t cn_tracer_store_bytes(const cn_device_field *field);
/* Sends the field with the stream unless the device has it. The caller gives it back. CN_ERR_NOMEM, CN_ERR_TOOL. */
CN_NODISCARD cn_status cn_tracer_store_field(cn_device_stream *stream, const cn_device_field *field,
                                             cn_stored_field **stored);
/* A field with a serial stays until its memory is needed. */
void cn_tracer_store_give_back(cn_vulkan *device, cn_stored_field **stored);
/* Frees all fields that nobody uses. False: there was none, or the store is busy. */
bool cn_tracer_store_trim(cn_vulkan *device);
/* Pipelines of these sizes; they stay until the store is closed. */
CN_NODISCARD cn_status cn_tracer_store_pipelines(cn_vulkan *device, const cn_tracer_sizes *sizes,
                                                 const cn_tracer_pipelines **pipelines);
/* Frees all of the store; nothing of it is in use. */
void cn_tracer_store_close(cn_vulkan *device);
#endif
