#include "device/step_session.h"

#include <stdlib.h>
#include <string.h>

enum {
    MAX_LANES = 64,
    WEIGHTS_PAST_END = 64 /* bytes that a layer may read behind the last weight */,
    LEAST_BUFFER = 16
};

static uint32_t most_rows(const cn_step_settings *s)
{
    const uint32_t rows[] = { s->enc_rows, s->density_width, s->colour_width, s->colour_in };
    uint32_t most = 0;
    for (size_t i = 0; i < sizeof rows / sizeof *rows; i++)
        if (rows[i] > most) most = rows[i];
    return most;
}

/* Threads per group, so that two layers of activations for each thread fit into shared memory; 0 when not even 8 do. */
static uint32_t lanes_of(const cn_vulkan *device, uint32_t rows)
{
    uint32_t n = MAX_LANES;
    while (n >= 8 && (uint64_t)2 * n * rows * sizeof(float) > device->properties.limits.maxComputeSharedMemorySize)
        n /= 2;
    return n >= 8 ? n : 0;
}

static void sizes(const cn_step_batch *b, size_t size[CN_STEP_BUFFERS])
{
    const cn_step_settings *s = &b->settings;
    const size_t lanes = (size_t)s->panel_cap * CN_PANEL, word = sizeof(uint32_t);
    const size_t entries = b->array[CN_STEP_TABLE].bytes / word,
                 acts = (size_t)s->enc_rows + s->density_width + s->colour_in + 2 * (size_t)s->colour_width;
    const size_t d_acts = 4 + 2 * (size_t)s->colour_width + s->colour_in + s->density_width;
    for (int i = 0; i < CN_STEP_ARRAYS; i++)
        size[i] = b->array[i].bytes;
    size[CN_STEP_VALUES] += WEIGHTS_PAST_END;
    size[CN_STEP_DERIVED] += WEIGHTS_PAST_END;
    size[CN_OWN_SETTINGS] = sizeof *s;
    size[CN_OWN_LEVELS] = s->levels * 4 * word;
    size[CN_OWN_LOGIT] = lanes * word;
    size[CN_OWN_LIVE] = size[CN_OWN_LIVE_POS] = size[CN_OWN_COLOUR] = lanes * 4 * word;
    size[CN_OWN_D_SAMPLE] = size[CN_OWN_D_PLACE] = lanes * 4 * word;
    size[CN_OWN_LIVE_FROM] = lanes * 2 * word;
    size[CN_OWN_SPANS] = (size_t)CN_STEP_GROUPS * CN_STEP_GROUP * 4 * word;
    size[CN_OWN_PANEL_GROUP] = s->panel_cap * word;
    size[CN_OWN_ACTS] = lanes * acts * word;
    size[CN_OWN_D_ACTS] = lanes * d_acts * word;
    size[CN_OWN_FIXED] = entries * 4 * word;
    size[CN_OWN_TOUCHED] = (entries / CN_TOUCH + s->levels + 1) * word;
    size[CN_OWN_CELL_MOST] = CN_OCC_CELLS * word;
    size[CN_OWN_SINGLE_VIEW] = s->support_cells ? lanes * word : 0;
    size[CN_OWN_SUPPORT_LAST] = size[CN_OWN_SUPPORT_COUNT] = s->support_cells * word;
    const size_t kept = s->n_values > s->n_weights ? (size_t)CN_STEP_GROUPS * CN_STEP_GROUP * word : 0;
    size[CN_OWN_EFFECT_X] = kept * CN_EFFECT_X_ROWS;
    size[CN_OWN_EFFECT_D] = kept * CN_EFFECT_D_ROWS;
    size[CN_OWN_GROUP_SUMS] = (size_t)CN_STEP_GROUPS * CN_STEP_SUM_KINDS * word;
    size[CN_OWN_RUN_MEAN] = (size_t)CN_EFFECT_COLUMNS * s->n_photos * word;
    size[CN_OWN_DRAWN] = (size_t)CN_STEP_GROUPS * CN_STEP_GROUP * word;
    for (int i = CN_OWN_MAPS; i <= CN_OWN_MAPS_END; i++)
        size[i] = 0;
    for (int i = 0; i < CN_STEP_BUFFERS; i++)
        if (size[i] < LEAST_BUFFER) size[i] = LEAST_BUFFER;
}

uint64_t cn_step_session_bytes(const cn_step_batch *batch)
{
    size_t size[CN_STEP_BUFFERS];
    uint64_t sum = 0;
    sizes(batch, size);
    for (int i = 0; i < CN_STEP_BUFFERS; i++)
        sum += size[i];
    return sum;
}

/* ---- the photos' maps ---- */

/* Where a map is: its buffer, and its first word there. As in shader/photos.glsl. */
typedef struct map_place {
    uint32_t block, word;
} map_place;

uint64_t cn_step_session_map_bytes(const cn_step_batch *batch)
{
    uint64_t sum = 0;
    for (uint32_t i = 0; i < batch->maps.n; i++)
        sum += sizeof(map_place) + batch->maps.bytes[i];
    return sum;
}

/* Fills one buffer after the other; none has more than `most` bytes, and no map lies in two. The places come first, in
 * the first one. size: of the buffers. place: may be NULL. False: the maps need more buffers than there are. */
static bool place_maps(const cn_step_maps *maps, uint64_t most, size_t size[CN_MAP_BLOCKS], map_place *place)
{
    uint32_t block = 0;
    for (int i = 0; i < CN_MAP_BLOCKS; i++)
        size[i] = LEAST_BUFFER;
    size[0] += maps->n * sizeof *place;
    for (uint32_t i = 0; i < maps->n; i++) {
        while (block < CN_MAP_BLOCKS && maps->bytes[i] + size[block] > most)
            block++;
        if (block == CN_MAP_BLOCKS) return false;
        if (place) place[i] = (map_place){ block, (uint32_t)((size[block] - LEAST_BUFFER) / sizeof(uint32_t)) };
        size[block] += maps->bytes[i];
    }
    return true;
}

/* Buffers for the maps, or small ones that stand in for them. */
static cn_status make_map_buffers(cn_step_session *s)
{
    size_t size[CN_MAP_BLOCKS] = { LEAST_BUFFER, LEAST_BUFFER, LEAST_BUFFER, LEAST_BUFFER };
    if (s->draws && !place_maps(&s->batch->maps, s->device->block_bytes, size, NULL)) s->draws = false;
    for (int i = 0; i < CN_MAP_BLOCKS; i++)
        CN_TRY(
            cn_device_buffer_create(s->device, s->draws ? size[i] : LEAST_BUFFER, false, &s->buffer[CN_OWN_MAPS + i]));
    return CN_OK;
}

/* room: bytes that the device had free before the session took its own. Where it has no memory left after all, it goes
 * without the maps. */
static cn_status make_maps(cn_step_session *s, uint64_t room)
{
    const uint64_t all = cn_step_session_bytes(s->batch) + cn_step_session_map_bytes(s->batch);
    s->draws = s->batch->maps.n > 0 && all <= room;
    const cn_status status = make_map_buffers(s);
    if (status != CN_ERR_NOMEM || !s->draws) return status;
    for (int i = 0; i < CN_MAP_BLOCKS; i++)
        cn_device_buffer_destroy(s->device, &s->buffer[CN_OWN_MAPS + i]);
    s->draws = false;
    return make_map_buffers(s);
}

/* ---- commands ---- */

static cn_status record(cn_step_session *s, VkCommandBuffer *commands)
{
    cn_device_stream *stream = &s->stream[s->at];
    *commands = stream->commands;
    if (s->recording) return CN_OK;
    if (s->pending[s->at]) CN_TRY(cn_device_stream_wait(stream));
    s->pending[s->at] = false;
    CN_TRY(cn_device_stream_begin(stream));
    s->recording = true;
    return CN_OK;
}

cn_status cn_step_session_submit(cn_step_session *s)
{
    if (!s->recording) return CN_OK;
    CN_TRY(cn_device_stream_submit(&s->stream[s->at]));
    s->recording = false;
    s->pending[s->at] = true;
    s->at ^= 1;
    return CN_OK;
}

/* Waits until all is done. */
static cn_status finish(cn_step_session *s)
{
    CN_TRY(cn_step_session_submit(s));
    for (uint32_t i = 0; i < 2; i++) {
        const uint32_t which = (s->at + i) % 2; /* the older one first */
        if (s->pending[which]) CN_TRY(cn_device_stream_wait(&s->stream[which]));
        s->pending[which] = false;
    }
    s->copying = false;
    return CN_OK;
}

static uint64_t in_use(const cn_step_session *s, uint64_t arrays)
{
    uint64_t used = 0;
    for (int i = 0; i < CN_STEP_ARRAYS; i++)
        if (arrays & CN_STEP_BIT(i) && s->batch->array[i].bytes) used |= CN_STEP_BIT(i);
    return used;
}

static cn_status move(cn_step_session *s, uint64_t arrays, bool to_device)
{
    VkCommandBuffer commands;
    if (!arrays) return CN_OK;
    CN_TRY(record(s, &commands));
    s->copying = true;
    for (int i = 0; i < CN_STEP_ARRAYS; i++) {
        if (!(arrays & CN_STEP_BIT(i))) continue;
        const cn_step_host *host = &s->batch->array[i];
        VkDeviceSize at;
        const VkBuffer shared = cn_device_find(s->device, host->data, host->bytes, &at);
        const VkBufferCopy up = { at, 0, host->bytes }, down = { 0, at, host->bytes };
        if (to_device)
            s->device->CmdCopyBuffer(commands, shared, s->buffer[i].handle, 1, &up);
        else
            s->device->CmdCopyBuffer(commands, s->buffer[i].handle, shared, 1, &down);
    }
    cn_device_stream_barrier(&s->stream[s->at]);
    return CN_OK;
}

cn_status cn_step_session_send(cn_step_session *s, uint64_t arrays)
{
    const uint64_t missing = in_use(s, arrays) & ~s->on_device;
    CN_TRY(move(s, missing, true));
    s->on_device |= missing;
    return CN_OK;
}

cn_status cn_step_session_fetch(cn_step_session *s, uint64_t arrays)
{
    const uint64_t missing = in_use(s, arrays) & ~s->on_host;
    CN_TRY(move(s, missing, false));
    if (s->copying) CN_TRY(finish(s));
    s->on_host |= missing;
    return CN_OK;
}

void cn_step_session_host_wrote(cn_step_session *s, uint64_t arrays)
{
    s->on_host |= arrays;
    s->on_device &= ~arrays;
}

static cn_status send_settings(cn_step_session *s)
{
    VkCommandBuffer commands;
    if (memcmp(&s->settings, &s->batch->settings, sizeof s->settings) == 0) return CN_OK;
    s->settings = s->batch->settings;
    CN_TRY(record(s, &commands));
    s->device->CmdUpdateBuffer(commands, s->buffer[CN_OWN_SETTINGS].handle, 0, sizeof s->settings, &s->settings);
    cn_device_stream_barrier(&s->stream[s->at]);
    return CN_OK;
}

cn_status cn_step_session_pass(cn_step_session *s, cn_step_pass pass, uint32_t x, uint32_t y)
{
    const cn_vulkan *d = s->device;
    const cn_step_pass_about *about = &cn_step_about[pass];
    const cn_step_pipelines *p = &s->pipelines;
    uint64_t arrays = 0;
    VkCommandBuffer commands;
    for (uint32_t i = 0; i < about->n; i++)
        if (about->binding[i] < CN_STEP_ARRAYS) arrays |= CN_STEP_BIT(about->binding[i]);
    CN_TRY(send_settings(s));
    CN_TRY(cn_step_session_send(s, arrays));
    if (!x || !y) return CN_OK;
    if (x > d->properties.limits.maxComputeWorkGroupCount[0])
        return cn_fail(CN_ERR_TOOL, "%s does not run the %u groups of threads of the pass '%s'", d->base.info.name, x,
                       about->name);
    CN_TRY(record(s, &commands));
    d->CmdBindPipeline(commands, VK_PIPELINE_BIND_POINT_COMPUTE, p->pipeline[pass]);
    d->CmdBindDescriptorSets(commands, VK_PIPELINE_BIND_POINT_COMPUTE, p->layout[pass], 0, 1, &p->set[pass], 0, NULL);
    d->CmdDispatch(commands, x, y, 1);
    cn_device_stream_barrier(&s->stream[s->at]);
    s->on_device |= about->writes;
    s->on_host &= ~about->writes;
    return CN_OK;
}

cn_status cn_step_session_clear(cn_step_session *s, uint32_t buffer)
{
    VkCommandBuffer commands;
    CN_TRY(record(s, &commands));
    s->device->CmdFillBuffer(commands, s->buffer[buffer].handle, 0, VK_WHOLE_SIZE, 0);
    cn_device_stream_barrier(&s->stream[s->at]);
    if (buffer >= CN_STEP_ARRAYS) return CN_OK;
    s->on_device |= CN_STEP_BIT(buffer);
    s->on_host &= ~CN_STEP_BIT(buffer);
    return CN_OK;
}

static cn_status send_maps(cn_step_session *s, const cn_context *ctx, cn_device_stream *stream, map_place *place,
                           void *data)
{
    const cn_step_maps *maps = &s->batch->maps;
    size_t size[CN_MAP_BLOCKS];
    (void)place_maps(maps, s->device->block_bytes, size, place); /* which has succeeded once */
    CN_TRY(cn_device_put(stream, &s->buffer[CN_OWN_MAPS], 0, place, maps->n * sizeof *place));
    for (uint32_t i = 0; i < maps->n; i++) {
        if (cn_stopping(ctx))
            return cn_fail(CN_ERR_INTERRUPTED, "stopped at the start of training; run the same command to resume");
        CN_TRY(maps->read(maps->user, ctx, i, data));
        CN_TRY(cn_device_put(stream, &s->buffer[CN_OWN_MAPS + place[i].block], place[i].word * sizeof(uint32_t), data,
                             (size_t)maps->bytes[i]));
    }
    return CN_OK;
}

cn_status cn_step_session_send_maps(cn_step_session *s, const cn_context *ctx)
{
    const cn_step_maps *maps = &s->batch->maps;
    uint64_t most = 0;
    cn_device_stream stream = { 0 };
    for (uint32_t i = 0; i < maps->n; i++)
        if (maps->bytes[i] > most) most = maps->bytes[i];
    CN_TRY(finish(s)); /* the buffers are cleared before */
    map_place *place = malloc(maps->n * sizeof *place);
    void *data = malloc(most);
    cn_status status = place && data ? cn_device_stream_create(s->device, true, &stream)
                                     : cn_fail(CN_ERR_NOMEM, "out of memory at the start of training");
    if (status == CN_OK) status = send_maps(s, ctx, &stream, place, data);
    cn_device_stream_destroy(&stream);
    free(place);
    free(data);
    s->has_maps = status == CN_OK;
    return status;
}

/* ---- open and close ---- */

static cn_status send_levels(cn_step_session *s)
{
    uint32_t level[CN_MAX_LEVELS][4];
    VkCommandBuffer commands;
    for (uint32_t l = 0; l < s->batch->settings.levels; l++) {
        const cn_level *of = &s->batch->level[l];
        const uint32_t row[4] = { of->resolution, of->entries, of->offset, of->hashed };
        memcpy(level[l], row, sizeof row);
    }
    CN_TRY(record(s, &commands));
    s->device->CmdUpdateBuffer(commands, s->buffer[CN_OWN_LEVELS].handle, 0, s->batch->settings.levels * sizeof *level,
                               level);
    cn_device_stream_barrier(&s->stream[s->at]);
    return CN_OK;
}

/* Copies between the device and the trainer's arrays need memory that both see. */
static bool shares_arrays(const cn_step_session *s)
{
    const uint64_t used = in_use(s, CN_STEP_BIT(CN_STEP_ARRAYS) - 1);
    for (int i = 0; i < CN_STEP_ARRAYS; i++) {
        const cn_step_host *host = &s->batch->array[i];
        VkDeviceSize at;
        if (used & CN_STEP_BIT(i) && !cn_device_find(s->device, host->data, host->bytes, &at)) return false;
    }
    return true;
}

static cn_status build(cn_step_session *s)
{
    size_t size[CN_STEP_BUFFERS];
    const cn_step_settings *about = &s->batch->settings;
    const cn_device_info *info = &s->device->base.info;
    const uint32_t rows = most_rows(about);
    const uint64_t bytes = cn_step_session_bytes(s->batch), room = cn_vulkan_available(&s->device->base);
    s->lanes = lanes_of(s->device, rows);
    if (!s->lanes)
        return cn_fail(CN_ERR_TOOL, "%s has too little shared memory for a network of width %u", info->name, rows);
    if (!shares_arrays(s))
        return cn_fail(CN_ERR_TOOL, "%s has too little memory that it shares with the processor for this training",
                       info->name);
    if (bytes > info->bytes)
        return cn_fail(CN_ERR_NOMEM, "%s has %.2f GB, and training this tile needs %.2f GB", info->name,
                       (double)info->bytes / 1e9, (double)bytes / 1e9);
    for (int i = 0; i < 2; i++)
        CN_TRY(cn_device_stream_create(s->device, false, &s->stream[i]));
    sizes(s->batch, size);
    for (uint32_t i = 0; i < CN_OWN_MAPS; i++)
        CN_TRY(cn_device_buffer_create(s->device, size[i], false, &s->buffer[i]));
    CN_TRY(make_maps(s, room));
    for (uint32_t i = 0; i < CN_STEP_BUFFERS; i++)
        CN_TRY(cn_step_session_clear(s, i));
    CN_TRY(cn_step_pipelines_create(s->device, s->lanes, rows, s->buffer, &s->pipelines));
    s->on_host = ~(uint64_t)0;
    s->on_device = 0;
    return send_levels(s);
}

cn_status cn_step_session_open(cn_step_session *s, cn_vulkan *device, const cn_step_batch *batch)
{
    s->device = device;
    s->batch = batch;
    s->open = true;
    const cn_status status = build(s);
    if (status != CN_OK) cn_step_session_close(s);
    return status;
}

void cn_step_session_close(cn_step_session *s)
{
    cn_vulkan *device = s->device;
    for (int i = 0; s->open && i < 2; i++)
        if (s->pending[i]) (void)!cn_device_stream_wait(&s->stream[i]);
    if (s->open) cn_step_pipelines_destroy(device, &s->pipelines);
    for (int i = 0; s->open && i < CN_STEP_BUFFERS; i++)
        cn_device_buffer_destroy(device, &s->buffer[i]);
    for (int i = 0; s->open && i < 2; i++)
        cn_device_stream_destroy(&s->stream[i]);
    s->open = s->recording = s->pending[0] = s->pending[1] = false;
    s->pipelines = (cn_step_pipelines){ 0 };
}
