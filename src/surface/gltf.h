/* What files of meshes have in common: bytes, the head of a GLB, and what they say of themselves. */
#ifndef CONURB_SURFACE_GLTF_H
#define CONURB_SURFACE_GLTF_H
#include "base/json.h"
#include "conurb/geo.h"

#include <stdio.h>
#include <string.h>

typedef struct cn_mesh_about {
    const cn_frame *frame;
    const char *appearance, *tiles; /* tiles: NULL, or which ones */
    double cube_m;
} cn_mesh_about;
/* For `extras`. NULL when out of memory. */
json_t *cn_mesh_about_json(const cn_mesh_about *about);
/* The same as lines of comment; mark begins each. */
void cn_mesh_comments(FILE *stream, const cn_mesh_about *about, const char *mark);

/* Little-endian on every machine. Returns the byte after. */
static inline uint8_t *cn_put_32(uint8_t *to, uint32_t value)
{
    for (int b = 0; b < 4; b++)
        to[b] = (uint8_t)(value >> (8 * b));
    return to + 4;
}
static inline uint8_t *cn_put_float(uint8_t *to, float value)
{
    uint32_t bits;
    memcpy(&bits, &value, sizeof bits);
    return cn_put_32(to, bits);
}
/* glTF has y up: x east, y up, z south. */
static inline void cn_gltf_turn(const float from[3], float to[3])
{
    to[0] = from[0];
    to[1] = from[2];
    to[2] = -from[1];
}
/* The head of a GLB: its JSON (taken; NULL: CN_ERR_NOMEM), and the head of the binary chunk of `size` bytes, a multiple
 * of 4, which follow. */
CN_NODISCARD cn_status cn_gltf_head(FILE *stream, json_t *root, uint32_t size);
#endif
