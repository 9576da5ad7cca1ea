/* The light that a person asks for by name, and the rows that it means in each tile. */
#ifndef CONURB_APPEARANCE_SPEC_H
#define CONURB_APPEARANCE_SPEC_H
#include "appearance/query_image.h"
#include "conurb/tile.h"

#include <jansson.h>

typedef enum cn_appearance_kind {
    CN_APPEARANCE_MEAN,
    CN_APPEARANCE_PHOTO, /* the photo's row where a tile was trained on it, else fitted to it */
    CN_APPEARANCE_KNOWN, /* only what EXIF says of the photo; trained values at the mean, or matched to a neighbour's */
    CN_APPEARANCE_FIT,   /* fitted to the photo, trained on or not */
    CN_APPEARANCE_FIT_LEFT, /* fitted to its left half: NeRF-W's protocol (Martin-Brualla et al. 2021, section 5) */
    CN_APPEARANCE_MIX,      /* between two photos */
    CN_APPEARANCE_BETWEEN,  /* between two lights: a step of a sequence */
    CN_APPEARANCE_FILE      /* rows of a file that `conurb appearance CITY export` wrote */
} cn_appearance_kind;

typedef struct cn_appearance_spec {
    cn_appearance_kind kind;
    char a[256], b[256]; /* photos' names in the index; a: the file's path; a photo from outside: absolute path, hash of
                            its bytes */
    double t;
    const struct cn_appearance_spec *from, *to;
    json_t *file;
} cn_appearance_spec;

/* PHOTO | mean | A:B:0.3 | FILE.json | fit:PHOTO, of the collection or any file | a name that `conurb appearance CITY
 * import` gave. CN_ERR_USAGE says what is wrong with the text. text NULL: mean. Caller deinits. */
CN_NODISCARD cn_status cn_appearance_spec_parse(cn_appearance_spec *spec, const char *text, const cn_city *city,
                                                const cn_photo_index *photos);
void cn_appearance_spec_deinit(cn_appearance_spec *spec);
/* Of all that the light depends on, but for the tiles. */
uint64_t cn_appearance_spec_hash(const cn_appearance_spec *spec, uint64_t hash);
/* As one would give it on the command line: for a render's metadata. */
void cn_appearance_spec_describe(const cn_appearance_spec *spec, char *out, size_t size);
/* A sequence "A,B,C" of lights. Caller frees with cn_appearance_specs_free. */
CN_NODISCARD cn_status cn_appearance_specs_parse(cn_appearance_spec **specs, uint32_t *n, const char *text,
                                                 const cn_city *city, const cn_photo_index *photos);
void cn_appearance_specs_free(cn_appearance_spec *specs, uint32_t n);
/* Frame i of n_frames along a sequence: eased in and out of each light, which is reached exactly. */
cn_appearance_spec cn_appearance_specs_at(const cn_appearance_spec *specs, uint32_t n, uint32_t i, uint32_t n_frames);

/* Rows that were fitted, by tile and photo, so that a sequence fits each once. kind: CN_APPEARANCE_FIT,
 * CN_APPEARANCE_FIT_LEFT, or CN_APPEARANCE_KNOWN where it was matched to what a neighbour shows. */
typedef struct cn_appearance_fit {
    char tile[CN_TILE_ID_SIZE];
    char photo[256];
    cn_appearance_kind kind;
    cn_appearance row;
} cn_appearance_fit;
/* A plain light's rows that were matched between tiles: {"tiles": {ID: row}} of the file at path. */
typedef struct cn_appearance_aligned {
    cn_appearance_kind kind;
    char photo[256];
    json_t *root;
    char *path;
} cn_appearance_aligned;
/* Photos from outside the collection, by absolute path, so that each is found once. */
typedef struct cn_appearance_query {
    char path[256];
    cn_query_image query;
} cn_appearance_query;
typedef struct cn_appearance_cache {
    cn_appearance_fit *fits;
    uint32_t n, room;
    cn_appearance_aligned *aligned;
    uint32_t n_aligned;
    cn_appearance_query *queries;
    uint32_t n_queries;
} cn_appearance_cache;
/* Takes root over, also when it fails. */
CN_NODISCARD cn_status cn_appearance_cache_add_aligned(cn_appearance_cache *cache, const cn_appearance_spec *spec,
                                                       json_t *root, const char *path);
/* Keeps a tile's row of a photo. */
CN_NODISCARD cn_status cn_appearance_cache_add_fit(cn_appearance_cache *cache, const cn_tile *tile, const char *photo,
                                                   cn_appearance_kind kind, const cn_appearance *row);
/* Forgets rows that belong to a tile, fitted and matched; photos from outside stay. */
void cn_appearance_cache_forget(cn_appearance_cache *cache);
void cn_appearance_cache_deinit(cn_appearance_cache *cache);

/* The row of a light in one tile: the matched one where there is a match. Else a tile that sees too little of a photo
 * to be fitted to it stays at its mean. */
CN_NODISCARD cn_status cn_appearance_spec_row(const cn_appearance_spec *spec, const cn_context *ctx,
                                              const cn_dataset *dataset, const cn_tile *tile,
                                              cn_appearance_cache *cache, cn_appearance *row);
#endif
