/* An appearance that is asked for by name, and its rows in each tile. */
#ifndef CONURB_APPEARANCE_SPEC_H
#define CONURB_APPEARANCE_SPEC_H
#include "appearance/query_image.h"
#include "conurb/tile.h"

#include <jansson.h>

/* In the city: lights that were fitted in `conurb view`, NAME.json each. */
#define CN_APPEARANCE_FITTED "views/fitted"

typedef enum cn_appearance_kind {
    CN_APPEARANCE_MEAN,
    CN_APPEARANCE_PHOTO,    /* the photo's row in tiles that were trained on it; in others, fitted to the photo */
    CN_APPEARANCE_KNOWN,    /* the photo's EXIF exposure, and the mean of its run, or aligned to a neighbour */
    CN_APPEARANCE_FIT,      /* fitted to the photo, trained on or not */
    CN_APPEARANCE_FIT_LEFT, /* fitted to its left half: NeRF-W's protocol (Martin-Brualla et al. 2021, section 5) */
    CN_APPEARANCE_MIX,      /* a mix of two photos; `first` and `second`, where they are there, are used instead */
    CN_APPEARANCE_BETWEEN,  /* a mix of two appearances: a step of a sequence */
    CN_APPEARANCE_FILE      /* rows of a file that `conurb appearance CITY export` wrote */
} cn_appearance_kind;

typedef struct cn_appearance_spec {
    cn_appearance_kind kind;
    char a[256], b[256]; /* names of the photos; for a file, a is its path; for a query photo, a is its absolute path
                            and b the hash of its bytes */
    double t;
    /* Of a mix, owned: NULL for the photos a and b; else the mean, a light with a name, or, of a mix of more than two,
     * the mix of all but the last. */
    struct cn_appearance_spec *first, *second;
    const struct cn_appearance_spec *from, *to;
    json_t *file;
} cn_appearance_spec;

/* Parses PHOTO | mean | A:B:0.3 | A:B:0.3:C:0.2 (that mix, then a fifth of C) | FILE.json | fit:PHOTO (of the
 * collection, or any file) | a name given by `conurb appearance CITY import` or in `conurb view`. Parts of a mix are
 * photos, mean and names. text NULL: mean. The caller deinits it. CN_ERR_USAGE: the message says what is wrong. */
CN_NODISCARD cn_status cn_appearance_spec_parse(cn_appearance_spec *spec, const char *text, const cn_city *city,
                                                const cn_photo_index *photos);
void cn_appearance_spec_deinit(cn_appearance_spec *spec);
/* Names of the lights that were imported, and of those that were fitted here, as an array of JSON, each sorted. The
 * caller calls json_decref. */
json_t *cn_appearance_lights(const cn_city *city);
/* A hash of everything that the appearance depends on, except the tiles. */
uint64_t cn_appearance_spec_hash(const cn_appearance_spec *spec, uint64_t hash);
/* The text as on the command line, for metadata: UTF-8, with '?' for each byte of a path that is none. */
void cn_appearance_spec_describe(const cn_appearance_spec *spec, char *out, size_t size);
/* Parses a sequence "A,B,C" of appearances. A name may have a comma: the longest piece that is an appearance is one.
 * The caller frees it with cn_appearance_specs_free. */
CN_NODISCARD cn_status cn_appearance_specs_parse(cn_appearance_spec **specs, uint32_t *n, const char *text,
                                                 const cn_city *city, const cn_photo_index *photos);
void cn_appearance_specs_free(cn_appearance_spec *specs, uint32_t n);
/* The appearance of frame i of n_frames along a sequence. Changes ease in and out, and each appearance is reached
 * exactly. */
cn_appearance_spec cn_appearance_specs_at(const cn_appearance_spec *specs, uint32_t n, uint32_t i, uint32_t n_frames);

/* A cache of fitted rows, by tile and photo, so that each is fitted once. kind: CN_APPEARANCE_FIT,
 * CN_APPEARANCE_FIT_LEFT, or CN_APPEARANCE_KNOWN for a row that was aligned to a neighbour. */
typedef struct cn_appearance_fit {
    char tile[CN_TILE_ID_SIZE];
    char photo[256];
    cn_appearance_kind kind;
    cn_appearance row;
} cn_appearance_fit;
/* Aligned rows of an appearance, {"tiles": {ID: row}}, from the file at path. */
typedef struct cn_appearance_aligned {
    cn_appearance_kind kind;
    char photo[256];
    json_t *root;
    char *path;
} cn_appearance_aligned;
/* Query photos, by absolute path, so that the pose of each is found once. */
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
/* Takes ownership of root, also on failure. */
CN_NODISCARD cn_status cn_appearance_cache_add_aligned(cn_appearance_cache *cache, const cn_appearance_spec *spec,
                                                       json_t *root, const char *path);
/* Keeps a query photo, which is then empty in the caller's hands. */
CN_NODISCARD cn_status cn_appearance_cache_add_query(cn_appearance_cache *cache, const char *path,
                                                     cn_query_image *query);
/* Keeps a tile's row of a photo. */
CN_NODISCARD cn_status cn_appearance_cache_add_fit(cn_appearance_cache *cache, const cn_tile *tile, const char *photo,
                                                   cn_appearance_kind kind, const cn_appearance *row);
/* Removes all fitted and aligned rows; query photos stay. */
void cn_appearance_cache_forget(cn_appearance_cache *cache);
void cn_appearance_cache_deinit(cn_appearance_cache *cache);

/* The row of an appearance in one tile: the aligned row if there is one. A tile that sees too little of a photo to be
 * fitted keeps its mean. */
CN_NODISCARD cn_status cn_appearance_spec_row(const cn_appearance_spec *spec, const cn_context *ctx,
                                              const cn_dataset *dataset, const cn_tile *tile,
                                              cn_appearance_cache *cache, cn_appearance *row);
#endif
