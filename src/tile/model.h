/* What a tile holds once it is open. Private to the library; the file's tensors and metadata are specified in
 * tiles/README.md. */
#ifndef CONURB_TILE_MODEL_H
#define CONURB_TILE_MODEL_H
#include "base/arena.h"
#include "conurb/tile.h"
#include "effect/effect.h"
#include "field/field.h"
#include "rays/rays.h"

#include <jansson.h>

#define CN_TILE_FORMAT 2 /* 2: the sky's code is linear */

struct cn_tile {
    cn_arena memory; /* of table and occupancy, in large pages; empty while a trainer lends its own */
    char id[CN_TILE_ID_SIZE];
    double radius_m;
    cn_box box;
    cn_field field;
    cn_field_params params;
    float *weights;       /* n_weights, owned: the layers in one buffer */
    float *field_derived; /* what the field makes of the weights */
    uint32_t *table;      /* in memory */
    const uint32_t *occupancy;
    cn_effect_pack pack, one; /* for n_names rows; for the one row of an appearance, without what a render leaves out */
    char **names;             /* photos with a row: trained on first, then held out */
    uint32_t n_names, n_trained;
    float *constants, *effect_params; /* rows, packed as in pack */
    float *shared, *derived;          /* the effects' shared parameters, and what they derive of them */
};

/* Everything but the pointers into a file: writes PATH atomically. table: [entries][2] bfloat16. */
typedef struct cn_tile_parts {
    const char *id, *parent_hash;
    double radius_m;
    const cn_box *box;
    const cn_field *field;
    const uint16_t *table;
    const float *weights;
    const uint32_t *occupancy;
    const cn_effect_pack *pack;
    const char *const *names;
    uint32_t n_names, n_trained;
    const float *constants, *effect_params, *shared;
    uint32_t steps;
} cn_tile_parts;
CN_NODISCARD cn_status cn_tile_save(const cn_tile_parts *parts, const char *path);

/* Lets a fit change all of a row that lights anything, be it known from EXIF or not. */
void cn_tile_appearance_unfreeze(const cn_tile *tile, cn_appearance *appearance);
/* A row as {"exposure": [..], "appearance": [..], ...} for a file, and back; effects that the file lacks stay at the
 * mean. CN_ERR_FORMAT names file and effect. */
json_t *cn_tile_appearance_to_json(const cn_tile *tile, const cn_appearance *appearance);
CN_NODISCARD cn_status cn_tile_appearance_from_json(const cn_tile *tile, const json_t *effects, const char *file,
                                                    cn_appearance *appearance);
#endif
