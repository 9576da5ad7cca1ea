/* Blocks of rays for the operation CN_OP_TRACE of other devices (device/trace.h). */
#ifndef CONURB_RENDER_TRACE_H
#define CONURB_RENDER_TRACE_H
#include "device/trace.h"
#include "render/raymarch.h"

/* Of a block, until it is back. */
typedef struct cn_march_kept {
    cn_march_ray ray[CN_BATCH_RAYS];
    uint32_t n_rays; /* the lens may have no ray for some pixels */
} cn_march_kept;

/* Describes the march for a device. False when that is not possible; then the processor marches. */
bool cn_march_describe(const cn_raymarch *march, cn_trace *trace);
/* As in cn_op; user is the cn_raymarch. */
void cn_march_pack(void *user, unsigned thread, const cn_op_packed *packed);
void cn_march_unpack(void *user, unsigned thread, const cn_op_packed *packed);
#endif
