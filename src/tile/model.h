/* The data of an open tile. Private to the library. tiles/README.md specifies the file's tensors and metadata. */
#ifndef CONURB_TILE_MODEL_H
#define CONURB_TILE_MODEL_H
#include "base/arena.h"
#include "conurb/tile.h"
#include "effect/effect.h"
#include "field/field.h"
#include "rays/rays.h"
#include "tile/seen.h"

#include <jansson.h>

/* 2: the sky's code is linear; 3: it is a colour and its slope. Skies of format 2 are no longer drawn. */
#define CN_TILE_FORMAT 3

struct cn_tile {
    cn_arena memory; /* holds table and occupancy, in huge pages; empty when a trainer lends its own */
    char id[CN_TILE_ID_SIZE];
    uint64_t serial; /* of this opening of the file, from 1: parameters do not change until it is closed */
    double radius_m;
    cn_box box;
    cn_field field;
    cn_field_params params;
    float *weights;       /* n_weights, owned: the layers in one buffer */
    float *field_derived; /* what the field derives from the weights */
    uint32_t *table;      /* in memory */
    const uint32_t *occupancy;
    cn_seen seen;             /* in memory; NULL where the tile has no sky, or its file is older */
    cn_effect_pack pack, one; /* pack: for n_names rows; one: for the single row of an appearance, without effects that
                                 a render leaves out */
    char **names;             /* photos with a row: trained on first, then held out */
    uint32_t n_names, n_trained;
    float *constants, *effect_params; /* rows, packed as in pack */
    float *shared, *derived;          /* the effects' shared parameters, and what is derived from them */
};

/* Writes the tile to PATH atomically. table: [entries][2] bfloat16. */
typedef struct cn_tile_parts {
    const char *id, *parent_hash;
    double radius_m;
    const cn_box *box;
    const cn_field *field;
    const uint16_t *table;
    const float *weights;
    const uint32_t *occupancy;
    const cn_seen *seen; /* NULL: the tile has no sky */
    const cn_effect_pack *pack;
    const char *const *names;
    uint32_t n_names, n_trained;
    const float *constants, *effect_params, *shared;
    uint32_t steps;
} cn_tile_parts;
CN_NODISCARD cn_status cn_tile_save(const cn_tile_parts *parts, const char *path);

/* Marks every value of a row that affects light as free for a fit, also those known from EXIF. */
void cn_tile_appearance_unfreeze(const cn_tile *tile, cn_appearance *appearance);
/* Convert a row to {"exposure": [..], "appearance": [..], ...} and back. Effects that the JSON lacks keep the mean.
 * CN_ERR_FORMAT: the message names file and effect. */
json_t *cn_tile_appearance_to_json(const cn_tile *tile, const cn_appearance *appearance);
CN_NODISCARD cn_status cn_tile_appearance_from_json(const cn_tile *tile, const json_t *effects, const char *file,
                                                    cn_appearance *appearance);
#endif
