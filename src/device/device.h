/* The seam between what is to be computed and what computes it. A device runs chains of operations over items; which
 * processor that is, render and train do not know. The processor is the first type of device; registry.c lists them.
 *
 * An operation is for a whole batch of items: rays, groups of rays, sections of a table. It always comes with a
 * function that does one item on the processor. The processor goes through a chain item by item, so that what an
 * operation leaves is in the cache for the next. Another device may go through it operation by operation. It takes the
 * operations that it knows (`kind`) and that say what they work on (`batch`), and leaves the others to the processor.
 */
#ifndef CONURB_DEVICE_DEVICE_H
#define CONURB_DEVICE_DEVICE_H
#include "base/arena.h"
#include "conurb/device.h"
#include "kernel/kernel.h"

/* Of a training step: rays are drawn, marched, placed and encoded; then networks, compositing and losses, forward and
 * backward; then the optimiser for weights, and for the table. Of a fit: its gather and shade. Of a render: rays, a
 * trace through the fields, pixels. */
typedef enum cn_op_kind {
    CN_OP_RAYS,
    CN_OP_MARCH,
    CN_OP_PLACE,
    CN_OP_ENCODE,
    CN_OP_SHADE,
    CN_OP_OPTIMISE,
    CN_OP_OPTIMISE_TABLE,
    CN_OP_OCCUPANCY,
    CN_OP_TRACE, /* batch: cn_trace (trace.h) */
    CN_OP_PIXELS,
    CN_OP_KINDS
} cn_op_kind;
extern const char *const cn_op_name[CN_OP_KINDS];

/* Where an operation on another device finds an item: buffers that the operation's kind describes, the item's place in
 * them, and `keep` bytes that are only kept from pack to unpack. */
typedef struct cn_op_packed {
    void *buffers, *kept;
    size_t place;
} cn_op_packed;

typedef struct cn_op {
    cn_op_kind kind;
    /* One item on the processor, with all that the operations before it in the chain have left for this worker. */
    void (*item)(void *user, size_t item, unsigned worker);
    /* What another device has to know, as the kind describes it. NULL: only the processor can do this one. */
    const void *batch;
    /* From what the worker holds of an item to the batch's buffers, and back. */
    void (*pack)(void *user, unsigned worker, const cn_op_packed *packed);
    void (*unpack)(void *user, unsigned worker, const cn_op_packed *packed);
    size_t keep;
} cn_op;

/* Operations that are done one after the other on each of so many items. Items do not depend on each other, and begin
 * in order, so that long ones belong first. */
typedef struct cn_chain {
    const cn_op *op;
    uint32_t n_ops;
    size_t items;
    void *user;
} cn_chain;

enum { CN_CHAINS = 8 }; /* that run at the same time */

typedef struct cn_device_type {
    const char *name; /* what a person gives to have one */
    /* The devices of this type here. CN_ERR_TOOL says why there is none. NULL: there is one, which needs no number. */
    cn_status (*list)(cn_device_info list[CN_DEVICE_MAX], uint32_t *n);
    /* which: of the list; -1: the best of it. */
    cn_status (*open)(long which, cn_device **device);
    void (*close)(cn_device *device);
    /* Memory that the processor and the device both reach, zeroed. */
    cn_status (*memory)(cn_device *device, size_t size, cn_arena *arena);
    void (*free_memory)(cn_device *device, cn_arena *arena);
    /* See cn_device_run. */
    cn_status (*run)(cn_device *device, const cn_context *ctx, const cn_chain *chains, uint32_t n);
} cn_device_type;
extern const cn_device_type cn_device_processor, cn_device_vulkan;
extern const cn_device_type *const cn_device_types[];
extern const uint32_t cn_device_n_types;

/* What every device begins with. */
struct cn_device {
    const cn_device_type *type;
    cn_device_info info;
    const cn_kernel *kernel; /* of what the processor does; NULL: the best that it has */
};

/* Runs up to CN_CHAINS chains that do not depend on each other, and returns when all are done. CN_ERR_INTERRUPTED only
 * where a device's operation may be stopped; of the processor's own ones none is. */
CN_NODISCARD cn_status cn_device_run(const cn_context *ctx, const cn_chain *chains, uint32_t n);
/* The same by the processor. */
void cn_processor_run(const cn_context *ctx, const cn_chain *chains, uint32_t n);

/* Memory for what a device works on. */
CN_NODISCARD cn_status cn_device_arena_init(const cn_context *ctx, cn_arena *arena, size_t size);
void cn_device_arena_deinit(const cn_context *ctx, cn_arena *arena);

/* Kernels for what the context's device leaves to the processor. floats: those that multiply in float. */
const cn_kernel *cn_device_kernel(const cn_context *ctx, bool floats);
#endif
