/* One training on a Vulkan device: buffers for its arrays, which of them are valid where, and the commands that are
 * recorded and not yet submitted. Private to device/. */
#ifndef CONURB_DEVICE_STEP_SESSION_H
#define CONURB_DEVICE_STEP_SESSION_H
#include "device/step_passes.h"

typedef struct cn_step_session {
    cn_vulkan *device;
    const cn_step_batch *batch;
    cn_step_settings settings; /* that the device has */
    cn_device_buffer buffer[CN_STEP_BUFFERS];
    cn_step_pipelines pipelines;
    cn_device_stream stream[2]; /* one is recorded while the other runs */
    bool pending[2], recording, open;
    bool refused; /* the device cannot do this training */
    bool draws;   /* it has room for the photos' maps, from which it draws the rays */
    bool has_maps;
    bool copying; /* a recorded or running command copies from or to the trainer's arrays */
    uint32_t at, lanes;
    uint64_t on_host, on_device; /* where each array is valid */
    bool effects_have_gradients; /* CN_STEP_SLOT_GRAD on the device may hold those of an earlier step */
    struct cn_step_session *next;
} cn_step_session;

/* Bytes on the device that a training with these arrays needs; and those for the photos' maps, on top. */
uint64_t cn_step_session_bytes(const cn_step_batch *batch);
uint64_t cn_step_session_map_bytes(const cn_step_batch *batch);
/* Opens the training; nothing is on the device yet. Where the maps do not fit into what is free, it goes without them.
 * CN_ERR_NOMEM, CN_ERR_TOOL: the device cannot do it. */
CN_NODISCARD cn_status cn_step_session_open(cn_step_session *session, cn_vulkan *device, const cn_step_batch *batch);
void cn_step_session_close(cn_step_session *session);

/* Brings the maps to the device, one after the other. An error of the trainer's `read`; CN_ERR_INTERRUPTED. */
CN_NODISCARD cn_status cn_step_session_send_maps(cn_step_session *session, const cn_context *ctx);
/* Makes arrays valid on the device, or on the processor. The processor waits for what is recorded, where it has to:
 * where an array is missing, or where a command may still read an array. Arrays that are not in use are skipped. */
CN_NODISCARD cn_status cn_step_session_send(cn_step_session *session, uint64_t arrays);
CN_NODISCARD cn_status cn_step_session_fetch(cn_step_session *session, uint64_t arrays);
/* The processor has changed these arrays. */
void cn_step_session_host_wrote(cn_step_session *session, uint64_t arrays);
/* Records a pass over x times y groups of threads. CN_ERR_TOOL: x is more than the device runs. */
CN_NODISCARD cn_status cn_step_session_pass(cn_step_session *session, cn_step_pass pass, uint32_t x, uint32_t y);
/* Sets a whole buffer to zeros. */
CN_NODISCARD cn_status cn_step_session_clear(cn_step_session *session, uint32_t buffer);
/* Submits what is recorded, and does not wait. */
CN_NODISCARD cn_status cn_step_session_submit(cn_step_session *session);
#endif
