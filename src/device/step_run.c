#include "device/step_run.h"

#include "device/step_session.h"

#include <stdlib.h>
#include <string.h>

enum {
    THREADS = 64, /* of a group, in passes over samples, rays or parameters */
    ENTRIES = 256 /* of a group, in passes over entries of the table */
};

static uint32_t groups(uint64_t n, uint32_t size)
{
    return (uint32_t)((n + size - 1) / size);
}

/* The training of this batch; it is made when it is not known yet. NULL: out of memory. */
static cn_step_session *session_of(cn_vulkan *device, const cn_step_batch *batch, bool make)
{
    pthread_mutex_lock(&device->lock);
    cn_step_session *s = device->sessions;
    while (s && s->batch != batch)
        s = s->next;
    if (!s && make && (s = calloc(1, sizeof *s))) {
        s->device = device;
        s->batch = batch;
        s->next = device->sessions;
        device->sessions = s;
    }
    pthread_mutex_unlock(&device->lock);
    return s;
}

void cn_step_close(cn_vulkan *device, const cn_arena *memory)
{
    cn_step_session **at = &device->sessions, *closed = NULL;
    pthread_mutex_lock(&device->lock);
    while (*at) {
        cn_step_session *s = *at;
        const unsigned char *data = s->batch->array[CN_STEP_TABLE].data;
        if (memory && (data < memory->base || data >= memory->base + memory->size)) {
            at = &s->next;
            continue;
        }
        *at = s->next;
        s->next = closed;
        closed = s;
    }
    pthread_mutex_unlock(&device->lock);
    while (closed) {
        cn_step_session *s = closed;
        closed = s->next;
        cn_step_session_close(s);
        free(s);
    }
}

static void say_once(cn_vulkan *device, const cn_context *ctx, cn_op_kind kind, const char *why)
{
    if (!__atomic_exchange_n(&device->said[kind], true, __ATOMIC_RELAXED))
        cn_log(ctx, CN_LOG_WARN, "%s; the processor does it instead", why);
}

/* ---- operations on the device ---- */

/* Effects with parameters of photos; those whose parameters have a mean of zero; those with a network. */
enum {
    EFFECTS_WITH_MEANS = CN_DOES_APPEARANCE | CN_DOES_SKY | CN_DOES_EXPOSURE | CN_DOES_POSE,
    EFFECTS_WITH_ROWS = EFFECTS_WITH_MEANS | CN_DOES_TRANSIENT,
    EFFECTS_WITH_HEADS = CN_DOES_SKY | CN_DOES_TRANSIENT
};

static bool does(const cn_step_session *s, uint32_t effects)
{
    return (s->batch->settings.effects & effects) != 0;
}

static cn_status over_lanes(cn_step_session *s, cn_step_pass pass, uint32_t threads, uint32_t y)
{
    const uint64_t room = (uint64_t)s->batch->settings.panel_cap * CN_PANEL,
                   most = (uint64_t)CN_STEP_GROUPS * CN_STEP_GROUP_CAP; /* which whole panels fill */
    return cn_step_session_pass(s, pass, groups(room < most ? room : most, threads), y);
}

static cn_status over_rays(cn_step_session *s, cn_step_pass pass)
{
    return cn_step_session_pass(s, pass, groups(s->batch->settings.n_rays, THREADS), 1);
}

static cn_status over_groups(cn_step_session *s, cn_step_pass pass)
{
    return cn_step_session_pass(s, pass, s->batch->settings.n_groups, 1);
}

/* Lets the processor do a part of the step for the effects. */
static cn_status run_hook(cn_step_session *s, const cn_context *ctx, cn_step_hook *hook, uint64_t reads,
                          uint64_t writes)
{
    const uint64_t always = CN_STEP_BIT(CN_STEP_VALUES) | CN_STEP_BIT(CN_STEP_COUNTS) |
                            CN_STEP_BIT(CN_STEP_GROUP_PANEL) | CN_STEP_BIT(CN_STEP_GROUP_SAMPLES) |
                            CN_STEP_BIT(CN_STEP_TARGET);
    CN_TRY(cn_step_session_fetch(s, always | reads));
    cn_pool_run(ctx->pool, CN_STEP_SLOTS, hook, s->batch->hooks.user);
    cn_step_session_host_wrote(s, writes);
    return CN_OK;
}

static cn_status draw(cn_step_session *s, const cn_context *ctx)
{
    const cn_step_settings *about = &s->batch->settings;
    if (!s->has_maps) CN_TRY(cn_step_session_send_maps(s, ctx));
    CN_TRY(over_groups(s, CN_STEP_DRAW));
    return about->has_measured || about->has_planes ? over_groups(s, CN_STEP_DEPTHS) : CN_OK;
}

static cn_status march(cn_step_session *s)
{
    if (does(s, CN_DOES_POSE)) CN_TRY(over_rays(s, CN_STEP_MOVE));
    return over_groups(s, CN_STEP_MARCH);
}

static cn_status shade_forward(cn_step_session *s, const cn_context *ctx)
{
    const cn_step_hooks *h = &s->batch->hooks;
    if (h->columns) CN_TRY(run_hook(s, ctx, h->columns, 0, CN_STEP_BIT(CN_STEP_CONDITIONING)));
    if (does(s, CN_DOES_DIRECTIONS | CN_DOES_APPEARANCE)) CN_TRY(over_rays(s, CN_STEP_CONDITION));
    CN_TRY(over_lanes(s, CN_STEP_LOGITS, s->lanes, 1));
    CN_TRY(over_groups(s, CN_STEP_LIVE));
    if (s->batch->settings.support_cells) CN_TRY(over_groups(s, CN_STEP_SUPPORT));
    CN_TRY(over_lanes(s, CN_STEP_FORWARD, s->lanes, 1));
    CN_TRY(over_rays(s, CN_STEP_COMPOSITE));
    if (!h->pixels) return over_groups(s, CN_STEP_EFFECTS);
    return run_hook(s, ctx, h->pixels, CN_STEP_BIT(CN_STEP_PIXEL),
                    CN_STEP_BIT(CN_STEP_D_PIXEL) | CN_STEP_BIT(CN_STEP_SUMS));
}

static cn_status shade_backward(cn_step_session *s, const cn_context *ctx)
{
    const cn_step_settings *about = &s->batch->settings;
    const cn_step_hooks *h = &s->batch->hooks;
    CN_TRY(over_groups(s, CN_STEP_SAMPLES));
    CN_TRY(over_lanes(s, CN_STEP_BACKWARD, s->lanes, 1));
    if (h->columns_backward || does(s, CN_DOES_APPEARANCE)) {
        const uint64_t values = (uint64_t)about->n_rays * (about->colour_in - CN_GEO_ROWS);
        CN_TRY(cn_step_session_pass(s, CN_STEP_COLUMNS, groups(values, THREADS), 1));
    }
    if (h->rays_backward || does(s, CN_DOES_POSE)) {
        CN_TRY(over_lanes(s, CN_STEP_POSITION, THREADS, 1));
        CN_TRY(over_rays(s, CN_STEP_RAY_GRAD));
    }
    if (h->columns_backward) CN_TRY(run_hook(s, ctx, h->columns_backward, CN_STEP_BIT(CN_STEP_D_COLUMNS), 0));
    if (h->rays_backward) CN_TRY(run_hook(s, ctx, h->rays_backward, CN_STEP_BIT(CN_STEP_D_RAYS), 0));
    return CN_OK;
}

/* Gradients of the effects' parameters. */
static cn_status effect_gradients(cn_step_session *s)
{
    if (does(s, EFFECTS_WITH_ROWS)) CN_TRY(cn_step_session_pass(s, CN_STEP_ROW_GRAD, CN_STEP_SLOTS, 1));
    if (does(s, EFFECTS_WITH_HEADS))
        CN_TRY(cn_step_session_pass(s, CN_STEP_HEAD_GRAD, groups(CN_EFFECT_WEIGHTS, THREADS), CN_STEP_SLOTS));
    if (does(s, CN_DOES_TRANSIENT))
        CN_TRY(cn_step_session_pass(s, CN_STEP_FEATURE_GRAD, CN_STEP_SLOTS, CN_EFFECT_LEVELS));
    return CN_OK;
}

/* Tiles of 4 x 4 weights in all layers. */
static uint32_t weight_tiles(const cn_step_settings *s)
{
    return s->n_weights / 16;
}

static cn_status shade(cn_step_session *s, const cn_context *ctx)
{
    const cn_step_hooks *h = &s->batch->hooks;
    const bool gradients = h->pixels || h->columns_backward || h->rays_backward;
    const cn_step_host *slot_grad = &s->batch->array[CN_STEP_SLOT_GRAD];
    if (h->pixels)
        say_once(s->device, ctx, CN_OP_SHADE, "a graphics processor does not do all effects of this training");
    if (gradients) {
        CN_TRY(cn_step_session_fetch(s, 0));
        memset(slot_grad->data, 0, slot_grad->bytes);
    } else if (s->effects_have_gradients || does(s, EFFECTS_WITH_ROWS)) {
        CN_TRY(cn_step_session_clear(s, CN_STEP_SLOT_GRAD));
    }
    s->effects_have_gradients = gradients || does(s, EFFECTS_WITH_ROWS);
    CN_TRY(shade_forward(s, ctx));
    CN_TRY(shade_backward(s, ctx));
    if (gradients) cn_step_session_host_wrote(s, CN_STEP_BIT(CN_STEP_SLOT_GRAD));
    CN_TRY(cn_step_session_pass(s, CN_STEP_WEIGHT_GRAD, groups(weight_tiles(&s->batch->settings), THREADS),
                                CN_STEP_SLOTS));
    CN_TRY(effect_gradients(s));
    CN_TRY(cn_step_session_pass(s, CN_STEP_SUM, CN_STEP_SLOTS, 1));
    /* The only thing that the host waits for: sums of the loss, and how many samples there were. */
    return cn_step_session_fetch(s, CN_STEP_BIT(CN_STEP_SUMS) | CN_STEP_BIT(CN_STEP_COUNTS));
}

/* What the effects ask of their parameters, and what they derive from them. */
static cn_status project(cn_step_session *s)
{
    const cn_step_hooks *h = &s->batch->hooks;
    if (h->project) {
        CN_TRY(cn_step_session_fetch(s, CN_STEP_BIT(CN_STEP_VALUES)));
        h->project(h->user, 0, 0);
        cn_step_session_host_wrote(s, CN_STEP_BIT(CN_STEP_VALUES) | CN_STEP_BIT(CN_STEP_EFFECTS_DERIVED));
        return CN_OK;
    }
    if (s->batch->settings.projects & EFFECTS_WITH_MEANS)
        CN_TRY(cn_step_session_pass(s, CN_STEP_PROJECT, CN_EFFECT_COLUMNS, 1));
    if (!does(s, EFFECTS_WITH_HEADS)) return CN_OK;
    return cn_step_session_pass(s, CN_STEP_EFFECT_DERIVE, groups(CN_EFFECT_WEIGHTS, THREADS), 1);
}

static cn_status optimise(cn_step_session *s)
{
    const cn_step_settings *about = &s->batch->settings;
    CN_TRY(cn_step_session_pass(s, CN_STEP_ADAM, groups(about->n_values, THREADS), 1));
    CN_TRY(cn_step_session_pass(s, CN_STEP_DERIVE, groups(about->n_weights, THREADS), 1));
    return project(s);
}

static cn_status optimise_table(cn_step_session *s)
{
    const cn_step_settings *about = &s->batch->settings;
    uint32_t most = 0;
    for (uint32_t l = 0; l < about->levels; l++)
        if (s->batch->level[l].entries > most) most = s->batch->level[l].entries;
    CN_TRY(cn_step_session_pass(s, CN_STEP_TABLE_GRAD, about->n_groups, about->levels));
    const uint32_t limit = s->device->properties.limits.maxComputeWorkGroupCount[0], all = groups(most, ENTRIES);
    CN_TRY(cn_step_session_pass(s, CN_STEP_TABLE_ADAM, all < limit ? all : limit, about->levels));
    CN_TRY(cn_step_session_clear(s, CN_OWN_TOUCHED));
    /* The last operation of a step: the device works on while the processor prepares the next one. */
    return cn_step_session_submit(s);
}

static cn_status occupancy(cn_step_session *s)
{
    CN_TRY(over_groups(s, CN_STEP_VISITS));
    CN_TRY(over_groups(s, CN_STEP_OCCUPANCY));
    if (s->batch->settings.support_cells) {
        CN_TRY(over_groups(s, CN_STEP_SUPPORT_LAST));
        CN_TRY(over_groups(s, CN_STEP_SUPPORT_COUNT));
        CN_TRY(over_groups(s, CN_STEP_SUPPORT_UPDATE));
    }
    return s->batch->settings.opens ? cn_step_session_pass(s, CN_STEP_OPEN, 1, 1) : CN_OK;
}

static cn_status on_device(cn_step_session *s, const cn_context *ctx, cn_op_kind kind)
{
    switch (kind) {
    case CN_OP_RAYS: return draw(s, ctx);
    case CN_OP_MARCH: return march(s);
    case CN_OP_LAY_OUT: return cn_step_session_pass(s, CN_STEP_LAY_OUT, 1, 1);
    case CN_OP_PLACE: return over_groups(s, CN_STEP_PLACE);
    case CN_OP_ENCODE: return over_lanes(s, CN_STEP_ENCODE, THREADS, s->batch->settings.levels);
    case CN_OP_SHADE: return shade(s, ctx);
    case CN_OP_OPTIMISE: return optimise(s);
    case CN_OP_OPTIMISE_TABLE: return optimise_table(s);
    case CN_OP_OCCUPANCY: return occupancy(s);
    default: return cn_fail(CN_ERR_INTERNAL, "operation %d is no part of a training step", (int)kind);
    }
}

/* ---- operations on the processor ---- */

static cn_status on_processor(cn_step_session *s, const cn_context *ctx, const cn_op *op, const cn_chain *chain)
{
    const cn_step_batch *b = s->batch;
    const cn_chain one = { op, 1, chain->items, chain->user };
    if (s->open) CN_TRY(cn_step_session_fetch(s, b->reads[op->kind]));
    cn_processor_run(ctx, &one, 1);
    if (s->open) cn_step_session_host_wrote(s, b->writes[op->kind]);
    return CN_OK;
}

/* Opens the training on the device at its first operation. Where that fails, the processor trains. */
static bool ready(cn_step_session *s, const cn_context *ctx)
{
    if (s->open || s->refused) return s->open;
    const char *why = s->batch->unfit;
    if (!why && cn_step_session_open(s, s->device, s->batch) != CN_OK) why = cn_error_message();
    s->refused = why != NULL;
    if (why) {
        say_once(s->device, ctx, CN_OP_RAYS, why);
        return false;
    }
    const double bytes = (double)cn_step_session_bytes(s->batch), maps = (double)cn_step_session_map_bytes(s->batch);
    cn_log(ctx, CN_LOG_INFO, "training on %s takes %.2f of its %.1f GB", s->device->base.info.name,
           (s->draws ? bytes + maps : bytes) / 1e9, (double)s->device->base.info.bytes / 1e9);
    if (maps > 0 && !s->draws)
        cn_log(ctx, CN_LOG_WARN,
               "%s has no room for the photos, %.3f GB on top; the processor draws the rays from them",
               s->device->base.info.name, maps / 1e9);
    return true;
}

cn_status cn_step_run(cn_vulkan *device, const cn_context *ctx, const cn_chain *chain)
{
    const cn_step_batch *batch = chain->op[0].batch;
    cn_step_session *s = session_of(device, batch, true);
    if (!s) return cn_fail(CN_ERR_NOMEM, "out of memory");
    for (uint32_t i = 0; i < chain->n_ops && chain->items; i++) {
        const cn_op *op = &chain->op[i];
        const bool able = op->kind != CN_OP_REFILL && !batch->by_processor[op->kind] && ready(s, ctx) &&
                          (op->kind != CN_OP_RAYS || s->draws);
        if (able)
            CN_TRY(on_device(s, ctx, op->kind));
        else
            CN_TRY(on_processor(s, ctx, op, chain));
        if (s->open && batch->by_processor[op->kind] && op->kind != CN_OP_RAYS)
            say_once(device, ctx, op->kind,
                     op->kind == CN_OP_SHADE ? "a graphics processor does not do all losses of this training"
                                             : "a graphics processor does not do all effects of this training");
    }
    return CN_OK;
}

cn_status cn_step_fetch(cn_device *base, const cn_step_batch *step)
{
    cn_step_session *s = session_of((cn_vulkan *)base, step, false);
    return s && s->open ? cn_step_session_fetch(s, ~(uint64_t)0) : CN_OK;
}

cn_status cn_step_forget(cn_device *base, const cn_step_batch *step)
{
    cn_step_session *s = session_of((cn_vulkan *)base, step, false);
    if (!s || !s->open) return CN_OK;
    CN_TRY(cn_step_session_fetch(s, 0)); /* waits */
    cn_step_session_host_wrote(s, CN_STEP_BIT(CN_STEP_ARRAYS) - 1);
    return CN_OK;
}
