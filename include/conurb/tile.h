/* conurb/tile.h: a trained tile on disk and in memory. tiles/README.md specifies the file format. */
#ifndef CONURB_TILE_H
#define CONURB_TILE_H
#include "conurb/base.h"
#include "conurb/geo.h"
#ifdef __cplusplus
extern "C" {
#endif

typedef enum cn_dtype { CN_F32, CN_F16, CN_BF16, CN_U8, CN_U32, CN_U64, CN_F64 } cn_dtype;
CN_API size_t cn_dtype_size(cn_dtype dtype);

/* One tensor of a safetensors file. In a bundle that was opened, data points into the bundle. */
typedef struct cn_tensor {
    char name[64];
    cn_dtype dtype;
    uint32_t n_dims;
    uint64_t dims[4];
    const void *data;
} cn_tensor;

/* A safetensors file: tensors and metadata strings. Use a bundle from one thread at a time while it is built; several
 * threads may read one that was opened. */
typedef struct cn_bundle cn_bundle;
CN_API CN_NODISCARD cn_status cn_bundle_create(cn_bundle **bundle);
CN_API void cn_bundle_destroy(cn_bundle **bundle);
/* Adds a tensor. data is borrowed until cn_bundle_write. CN_ERR_USAGE: the name is in use. */
CN_API CN_NODISCARD cn_status cn_bundle_add(cn_bundle *bundle, const char *name, cn_dtype dtype, uint32_t n_dims,
                                            const uint64_t *dims, const void *data);
/* Sets a metadata string; both strings are copied. */
CN_API CN_NODISCARD cn_status cn_bundle_set(cn_bundle *bundle, const char *key, const char *value);
/* Writes the file atomically (temporary name, fsync, rename). Tensors are in the order in which they were added,
 * aligned to 64 bytes; metadata are sorted by key. The same content gives the same bytes. */
CN_API CN_NODISCARD cn_status cn_bundle_write(const cn_bundle *bundle, const char *path);
/* Maps a file read-only. The caller destroys the bundle. CN_ERR_FORMAT: the header is invalid (sizes, offsets,
 * overlaps, gaps, types, depth, duplicate names). verify: also check the metadata string "checksum" (XXH3-64 of the
 * data section, hexadecimal), when there is one. */
CN_API CN_NODISCARD cn_status cn_bundle_open(cn_bundle **bundle, const char *path, bool verify);
CN_API uint32_t cn_bundle_count(const cn_bundle *bundle);
CN_API const cn_tensor *cn_bundle_at(const cn_bundle *bundle, uint32_t i);
CN_API const cn_tensor *cn_bundle_find(const cn_bundle *bundle, const char *name); /* NULL if absent */
CN_API const char *cn_bundle_get(const cn_bundle *bundle, const char *key);        /* NULL if absent */

/* A tile in memory, ready to render. It does not change after opening: several threads may use it. */
typedef struct cn_tile cn_tile;
/* n rays: origins [n][3] in metres of the local frame, and directions [n][3] of unit length. Borrowed. */
typedef struct cn_ray_list {
    size_t n;
    const double (*origin_m)[3], (*direction)[3];
} cn_ray_list;
/* The name of a file beside tile.safetensors: the tile as it was at the last checkpoint. It exists during training. */
#define CN_TILE_UNFINISHED "unfinished.safetensors"
/* Opens a tile.safetensors. The caller closes it. CN_ERR_VERSION: the format is newer than this Conurb. CN_ERR_FORMAT:
 * the file is damaged. */
CN_API CN_NODISCARD cn_status cn_tile_open(cn_tile **tile, const char *path);
CN_API void cn_tile_close(cn_tile **tile);
CN_API const char *cn_tile_id(const cn_tile *tile); /* valid until cn_tile_close */
CN_API void cn_tile_centre(const cn_tile *tile, double centre_m[3]);
CN_API double cn_tile_radius(const cn_tile *tile);  /* metres */
CN_API uint64_t cn_tile_bytes(const cn_tile *tile); /* memory that it takes */

/* ---- appearance ----
 *
 * The light of a render. A tile's effects hold one row of numbers for each photo: its exposure, its appearance
 * embedding and its sky embedding (Martin-Brualla et al. 2021). An appearance is such a row, the mean of all rows, or
 * a mix. A row is valid only for the tile that it was made from. */
#define CN_APPEARANCE_MAX 64
typedef struct cn_appearance {
    uint32_t n;
    float row[CN_APPEARANCE_MAX];
} cn_appearance;
/* The row of a photo; photo NULL: the mean of the photos trained on. For a held-out photo, the values are
 * those that its capture run and its neighbours suggest, else the mean. CN_ERR_USAGE: the tile does not know the photo.
 */
CN_API CN_NODISCARD cn_status cn_tile_appearance(const cn_tile *tile, const char *photo, cn_appearance *appearance);
/* out = (1 - t) a + t b. a and b must be of the same tile; out may be a or b; t may lie outside [0, 1]. */
CN_API void cn_appearance_mix(const cn_appearance *a, const cn_appearance *b, double t, cn_appearance *out);
/* Whether the tile has a row for a photo, and whether it was trained on the photo. */
CN_API bool cn_tile_has_photo(const cn_tile *tile, const char *photo);
CN_API bool cn_tile_trained_on(const cn_tile *tile, const char *photo);
/* The photos that the tile was trained on. Names are valid until cn_tile_close. */
CN_API uint32_t cn_tile_photo_count(const cn_tile *tile);
CN_API const char *cn_tile_photo_name(const cn_tile *tile, uint32_t i);
/* Whether the tile's photos have rows. Without rows, every appearance looks the same. */
CN_API bool cn_tile_has_appearance(const cn_tile *tile);

#ifdef __cplusplus
}
#endif
#endif
