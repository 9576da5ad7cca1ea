/* The interface between work and the devices that do it. A device runs chains of operations over items. Render and
 * train do not know which device it is. The processor is the first type of device; device.c lists them.
 *
 * An operation works on a batch of items: rays, groups of rays, sections of a table. It always has a function that
 * does one item on the processor. The processor runs a chain item by item, so that the result of an operation is in
 * the cache for the next. Another device may run it operation by operation. It does the operations that it supports
 * (`kind`) and that have a `batch`, and leaves the others to the processor. */
#ifndef CONURB_DEVICE_DEVICE_H
#define CONURB_DEVICE_DEVICE_H
#include "base/arena.h"
#include "conurb/device.h"
#include "kernel/kernel.h"

/* The kinds of operations. A training step (batch: cn_step_batch, step.h): rays are sampled and marched, their samples
 * laid out, placed and encoded; networks, compositing and losses run forward and backward; the optimiser updates the
 * weights and the table; the occupancy grid is updated. A fit: gather and shade. A render:
 * rays, a trace through the fields, pixels; density alone, for normals and openness. */
typedef enum cn_op_kind {
    CN_OP_RAYS,
    CN_OP_MARCH,
    CN_OP_LAY_OUT,
    CN_OP_PLACE,
    CN_OP_ENCODE,
    CN_OP_SHADE,
    CN_OP_OPTIMISE,
    CN_OP_OPTIMISE_TABLE,
    CN_OP_OCCUPANCY,
    CN_OP_REFILL,  /* of the occupancy grid; some times in a training. Always by the processor */
    CN_OP_TRACE,   /* batch: cn_trace (trace.h) */
    CN_OP_DENSITY, /* batch: cn_density_query (trace.h) */
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
    /* Does one item on the processor, after the earlier operations of the chain, on the same worker. */
    void (*item)(void *user, size_t item, unsigned worker);
    /* The data for other devices, as the kind describes them. NULL: only the processor can do this operation. */
    const void *batch;
    /* Copy an item from the worker's memory to the batch's buffers, and back. */
    void (*pack)(void *user, unsigned worker, const cn_op_packed *packed);
    void (*unpack)(void *user, unsigned worker, const cn_op_packed *packed);
    size_t keep;
} cn_op;

/* Operations that are done in order on each of n items. Items are independent and begin in order: put long ones first.
 */
typedef struct cn_chain {
    const cn_op *op;
    uint32_t n_ops;
    size_t items;
    void *user;
} cn_chain;

typedef struct cn_step_batch cn_step_batch; /* step.h */

enum { CN_CHAINS = 8 }; /* chains that may run at the same time */

typedef struct cn_device_type {
    const char *name; /* the name that users give */
    /* Lists the devices of this type. CN_ERR_TOOL: there is none; the message says why. NULL: there is exactly one,
     * without a number. */
    cn_status (*list)(cn_device_info list[CN_DEVICE_MAX], uint32_t *n);
    /* Opens device `which` of the list; -1: the best one. */
    cn_status (*open)(long which, cn_device **device);
    void (*close)(cn_device *device);
    /* Zeroed memory that both the processor and the device can access. */
    cn_status (*memory)(cn_device *device, size_t size, cn_arena *arena);
    void (*free_memory)(cn_device *device, cn_arena *arena);
    /* See cn_device_run. */
    cn_status (*run)(cn_device *device, const cn_context *ctx, const cn_chain *chains, uint32_t n);
    /* See cn_device_fetch and cn_device_forget. NULL: the device keeps nothing between two operations. */
    cn_status (*fetch)(cn_device *device, const cn_step_batch *step);
    cn_status (*forget)(cn_device *device, const cn_step_batch *step);
    /* See cn_device_available, cn_device_step_bytes and cn_device_map_bytes. NULL: it has no memory of its own. */
    uint64_t (*available)(cn_device *device);
    uint64_t (*step_bytes)(const cn_step_batch *step);
    uint64_t (*map_bytes)(const cn_step_batch *step);
} cn_device_type;
extern const cn_device_type cn_device_processor, cn_device_vulkan;
extern const cn_device_type *const cn_device_types[];
extern const uint32_t cn_device_n_types;

/* The first member of every device. */
struct cn_device {
    const cn_device_type *type;
    cn_device_info info;
    const cn_kernel *kernel; /* for work on the processor; NULL: the fastest */
    bool lost;               /* gone for good (Vulkan: VK_ERROR_DEVICE_LOST) */
    cn_device *next;         /* of a list */
};

/* Runs up to CN_CHAINS independent chains, and returns when all are done. CN_ERR_INTERRUPTED: an operation of a device
 * was stopped; operations on the processor are never stopped. */
CN_NODISCARD cn_status cn_device_run(const cn_context *ctx, const cn_chain *chains, uint32_t n);
/* The same on the processor. */
void cn_processor_run(const cn_context *ctx, const cn_chain *chains, uint32_t n);

/* Brings all arrays of a training step to the processor. */
CN_NODISCARD cn_status cn_device_fetch(const cn_context *ctx, const cn_step_batch *step);
/* The processor has changed the arrays: what the device has of them no longer counts. */
CN_NODISCARD cn_status cn_device_forget(const cn_context *ctx, const cn_step_batch *step);
/* Bytes that the context's device has free of its own memory, now; UINT64_MAX: it works in the processor's. */
uint64_t cn_device_available(const cn_context *ctx);
/* Bytes that a device with memory of its own needs for a training with these arrays; and for the maps, from which it
 * draws the rays, on top. */
uint64_t cn_device_step_bytes(const cn_step_batch *step);
uint64_t cn_device_map_bytes(const cn_step_batch *step);
/* Whether the context's device is gone, so that every further operation on it fails. */
bool cn_device_is_lost(const cn_context *ctx);
/* Whether work that ended with this error may go on without the device: it is lost, or it failed at a command or lacks
 * memory. Never for the processor. */
bool cn_device_gave_up(const cn_context *ctx, cn_status status);

/* Memory for a device's data. */
CN_NODISCARD cn_status cn_device_arena_init(const cn_context *ctx, cn_arena *arena, size_t size);
void cn_device_arena_deinit(const cn_context *ctx, cn_arena *arena);

/* Kernels for the work that the context's device leaves to the processor. floats: only kernels that multiply in float.
 */
const cn_kernel *cn_device_kernel(const cn_context *ctx, bool floats);
#endif
