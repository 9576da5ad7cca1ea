/* The light that a person asks for by name, and the rows that it means in each tile. */
#ifndef CONURB_JOB_LIGHT_H
#define CONURB_JOB_LIGHT_H
#include "job/guest.h"

#include <jansson.h>

typedef enum cn_light_kind {
    CN_LIGHT_MEAN,
    CN_LIGHT_PHOTO,    /* the photo's row where a tile was trained on it, else fitted to it */
    CN_LIGHT_KNOWN,    /* only what EXIF says of the photo; trained values at the mean, or matched to a neighbour's */
    CN_LIGHT_FIT,      /* fitted to the photo, trained on or not */
    CN_LIGHT_FIT_LEFT, /* fitted to its left half: NeRF-W's protocol (Martin-Brualla et al. 2021, section 5) */
    CN_LIGHT_MIX,      /* between two photos */
    CN_LIGHT_BETWEEN,  /* between two lights: a step of a sequence */
    CN_LIGHT_FILE      /* rows of a file that `conurb appearance CITY export` wrote */
} cn_light_kind;

typedef struct cn_light {
    cn_light_kind kind;
    char a[256], b[256]; /* photos' names in the index; a: the file's path; a photo from outside: absolute path, hash of
                            its bytes */
    double t;
    const struct cn_light *from, *to;
    json_t *file;
} cn_light;

/* PHOTO | mean | A:B:0.3 | FILE.json | fit:PHOTO, of the collection or any file | a name that `conurb appearance CITY
 * import` gave. CN_ERR_USAGE says what is wrong with the text. text NULL: mean. Caller deinits. */
CN_NODISCARD cn_status cn_light_parse(cn_light *light, const char *text, const cn_city *city,
                                      const cn_photo_index *photos);
void cn_light_deinit(cn_light *light);
/* Of all that the light depends on, but for the tiles. */
uint64_t cn_light_hash(const cn_light *light, uint64_t hash);
/* As one would give it on the command line: for a render's metadata. */
void cn_light_describe(const cn_light *light, char *out, size_t size);
/* A sequence "A,B,C" of lights. Caller frees with cn_lights_free. */
CN_NODISCARD cn_status cn_lights_parse(cn_light **lights, uint32_t *n, const char *text, const cn_city *city,
                                       const cn_photo_index *photos);
void cn_lights_free(cn_light *lights, uint32_t n);
/* Frame i of n_frames along a sequence: eased in and out of each light, which is reached exactly. */
cn_light cn_light_at(const cn_light *lights, uint32_t n, uint32_t i, uint32_t n_frames);

/* Rows that were fitted, by tile and photo, so that a sequence fits each once. kind: CN_LIGHT_FIT, CN_LIGHT_FIT_LEFT,
 * or CN_LIGHT_KNOWN where it was matched to what a neighbour shows. */
typedef struct cn_light_fit {
    char tile[CN_TILE_ID_SIZE];
    char photo[256];
    cn_light_kind kind;
    cn_appearance row;
} cn_light_fit;
/* A plain light's rows that were matched between tiles: {"tiles": {ID: row}} of the file at path. */
typedef struct cn_light_match {
    cn_light_kind kind;
    char photo[256];
    json_t *root;
    char *path;
} cn_light_match;
/* Photos from outside the collection, by absolute path, so that each is found once. */
typedef struct cn_light_guest {
    char path[256];
    cn_guest guest;
} cn_light_guest;
typedef struct cn_light_cache {
    cn_light_fit *fits;
    uint32_t n, room;
    cn_light_match *matches;
    uint32_t n_matches;
    cn_light_guest *guests;
    uint32_t n_guests;
} cn_light_cache;
/* Takes root over, also when it fails. */
CN_NODISCARD cn_status cn_light_cache_add_match(cn_light_cache *cache, const cn_light *light, json_t *root,
                                                const char *path);
/* Keeps a tile's row of a photo. */
CN_NODISCARD cn_status cn_light_cache_add_fit(cn_light_cache *cache, const cn_tile *tile, const char *photo,
                                              cn_light_kind kind, const cn_appearance *row);
void cn_light_cache_deinit(cn_light_cache *cache);

/* The row of a light in one tile: the matched one where there is a match. Else a tile that sees too little of a photo
 * to be fitted to it stays at its mean. */
CN_NODISCARD cn_status cn_light_row(const cn_light *light, const cn_context *ctx, const cn_material *material,
                                    const cn_tile *tile, cn_light_cache *cache, cn_appearance *row);
#endif
