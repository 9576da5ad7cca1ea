/* Pictures as messages: a channel of the render as JPEG, and its depth as a coarse grid.
 *
 * A message is the length of its head (4 bytes, little endian), the head (JSON), the JPEG, and the depths: half floats,
 * metres along the ray, row by row, 0 where nothing is. The head has type ("frame"), id, slot, pass, last, width,
 * height, jpeg (bytes), grid ([columns, rows]), tile and ms (since it was asked for); for depth the range [near, far]
 * in metres, and for coverage [0, most] in photos, too; for a depth query, metres: the depth in the middle. */
#ifndef CONURB_VIEW_FRAME_H
#define CONURB_VIEW_FRAME_H
#include "conurb/renderer.h"
#include "view/out.h"
#include "view/request.h"

enum { CN_FRAME_QUALITY = 88, CN_FRAME_QUALITY_MOVING = 70, CN_FRAME_GRID = 64 /* columns */ };

CN_NODISCARD cn_status cn_frame_make(const cn_ask *ask, const cn_render_result *result, double since_s, cn_out **out);
/* The data of a message, after its head. A size may be 0. */
typedef struct cn_frame_data {
    const void *jpeg;
    size_t jpeg_size;
    const void *tail;
    size_t tail_size;
} cn_frame_data;
/* Builds a message from a head, to which the member jpeg is added, and the data after it. */
CN_NODISCARD cn_status cn_frame_join(json_t *head, const cn_frame_data *data, int slot, cn_out **out);
/* The colour of a tile of the plan. */
void cn_frame_tile_colour(uint32_t tile, float rgb[3]);
/* A channel as RGB in [0,1], for the screen: rgb[n][3]. range: what the colours mean, in metres for CN_CHANNEL_DEPTH,
 * and in photos for CN_CHANNEL_COVERAGE; other channels leave it. */
void cn_frame_channel(cn_channel channel, const cn_render_result *result, float *rgb, double range[2]);
#endif
