#include "view/frame.h"

#include "bridge/oiio.h"
#include "image/image.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

cn_status cn_frame_join(json_t *head, const cn_frame_data *data, int slot, cn_out **out)
{
    json_object_set_new(head, "jpeg", json_integer((json_int_t)data->jpeg_size));
    char *text = json_dumps(head, JSON_COMPACT | JSON_REAL_PRECISION(10));
    const size_t n = text ? strlen(text) : 0;
    *out = text ? cn_out_create(NULL, 4 + n + data->jpeg_size + data->tail_size, true, slot) : NULL;
    if (*out) {
        uint8_t *at = (*out)->bytes + CN_OUT_ROOM;
        for (int i = 0; i < 4; i++)
            *at++ = (uint8_t)(n >> (8 * i));
        memcpy(at, text, n);
        if (data->jpeg_size) memcpy(at + n, data->jpeg, data->jpeg_size);
        if (data->tail_size) memcpy(at + n + data->jpeg_size, data->tail, data->tail_size);
    }
    free(text);
    return *out ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory for a picture's message");
}

/* Depths in the middle of the grid's cells. */
static uint8_t *make_grid(const cn_picture *p, uint32_t size[2])
{
    size[0] = p->width < CN_FRAME_GRID ? p->width : CN_FRAME_GRID;
    size[1] = (uint32_t)(((uint64_t)p->height * size[0] + p->width / 2) / p->width);
    if (size[1] < 1) size[1] = 1;
    if (size[1] > p->height) size[1] = p->height;
    uint8_t *grid = malloc((size_t)size[0] * size[1] * 2);
    for (uint32_t y = 0; y < size[1] && grid; y++)
        for (uint32_t x = 0; x < size[0]; x++) {
            const size_t from = (size_t)((2u * y + 1) * p->height / (2u * size[1])) * p->width +
                                (2u * x + 1) * p->width / (2u * size[0]);
            const bool there = p->rgba[4 * from + 3] >= 0.5f;
            const uint16_t half = cn_half_from_float(there ? p->depth[from] : 0);
            uint8_t *to = grid + 2 * ((size_t)y * size[0] + x);
            to[0] = (uint8_t)half;
            to[1] = (uint8_t)(half >> 8);
        }
    return grid;
}

/* Of the pixel in the middle, not rounded as the grid's are; 0: nothing is there. */
static double middle_depth(const cn_picture *p)
{
    const size_t i = (size_t)(p->height / 2) * p->width + p->width / 2;
    return p->rgba[4 * i + 3] >= 0.5f ? (double)p->depth[i] : 0;
}

static cn_status encode_channel(const cn_ask *ask, const cn_render_result *result, uint8_t **jpeg, size_t *size,
                                double range[2])
{
    const cn_picture *p = result->picture;
    float *rgb = malloc((size_t)p->width * p->height * 3 * sizeof *rgb);
    if (!rgb) return cn_fail(CN_ERR_NOMEM, "out of memory for a picture of %u x %u pixels", p->width, p->height);
    cn_frame_channel(ask->channel, result, rgb, range);
    const int quality = ask->moving ? CN_FRAME_QUALITY_MOVING : CN_FRAME_QUALITY;
    const cn_status status =
        cn_oiio_encode((cn_oiio_encoding){ .jpeg = true, .quality = quality }, rgb, p->width, p->height, jpeg, size);
    free(rgb);
    return status;
}

static json_t *make_head(const cn_ask *ask, const cn_render_result *result, double since_s, const uint32_t grid[2])
{
    const bool last = result->pass == CN_PASS_FULL;
    return json_pack("{s:s, s:I, s:i, s:i, s:b, s:i, s:i, s:[ii], s:s, s:f}", "type", "frame", "id",
                     (json_int_t)ask->id, "slot", (int)ask->slot, "pass", result->pass, "last", (int)last, "width",
                     (int)result->picture->width, "height", (int)result->picture->height, "grid", (int)grid[0],
                     (int)grid[1], "tile", result->tile, "ms", 1000 * since_s);
}

cn_status cn_frame_make(const cn_ask *ask, const cn_render_result *result, double since_s, cn_out **out)
{
    const bool probe = ask->slot == CN_ASK_SLOT_PROBE;
    uint8_t *own = NULL;
    size_t size = result->encoded_size;
    double range[2] = { 0, 0 };
    uint32_t grid_size[2];
    if (!probe && !result->encoded) CN_TRY(encode_channel(ask, result, &own, &size, range));
    uint8_t *grid = make_grid(result->picture, grid_size);
    json_t *head = make_head(ask, result, since_s, grid_size);
    cn_status status = grid && head ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory for a picture's message");
    if (status == CN_OK && range[1] > 0) json_object_set_new(head, "range", json_pack("[ff]", range[0], range[1]));
    if (status == CN_OK && probe) json_object_set_new(head, "metres", json_real(middle_depth(result->picture)));
    const cn_frame_data data = { own ? own : result->encoded, size, grid, (size_t)grid_size[0] * grid_size[1] * 2 };
    if (status == CN_OK) status = cn_frame_join(head, &data, (int)ask->slot, out);
    json_decref(head);
    free(grid);
    free(own);
    return status;
}
