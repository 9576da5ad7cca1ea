/* conurb/tile.h: a trained tile on disk and in memory. The file format is specified in tiles/README.md. */
#ifndef CONURB_TILE_H
#define CONURB_TILE_H
#include "conurb/base.h"
#include "conurb/geo.h"
#ifdef __cplusplus
extern "C" {
#endif

typedef enum cn_dtype { CN_F32, CN_F16, CN_BF16, CN_U8, CN_U32, CN_U64, CN_F64 } cn_dtype;
CN_API size_t cn_dtype_size(cn_dtype dtype);

/* One tensor of a safetensors file. When reading, data points into the bundle. */
typedef struct cn_tensor {
    char name[64];
    cn_dtype dtype;
    uint32_t n_dims;
    uint64_t dims[4];
    const void *data;
} cn_tensor;

/* A safetensors file: tensors and string metadata. */
typedef struct cn_bundle cn_bundle;
CN_API CN_NODISCARD cn_status cn_bundle_create(cn_bundle **bundle);
CN_API void cn_bundle_destroy(cn_bundle **bundle);
/* data is borrowed until cn_bundle_write. CN_ERR_USAGE on a repeated name. */
CN_API CN_NODISCARD cn_status cn_bundle_add(cn_bundle *bundle, const char *name, cn_dtype dtype, uint32_t n_dims,
                                            const uint64_t *dims, const void *data);
CN_API CN_NODISCARD cn_status cn_bundle_set(cn_bundle *bundle, const char *key, const char *value);
/* Atomically (temporary name, fsync, rename). Tensors in the order of their addition, 64-byte aligned; metadata sorted
 * by key: same content, same bytes. */
CN_API CN_NODISCARD cn_status cn_bundle_write(const cn_bundle *bundle, const char *path);
/* Maps the file read-only. Hostile headers (sizes, offsets, overlaps, holes, types, depth, duplicate names) give
 * CN_ERR_FORMAT. metadata "checksum" (XXH3-64 of the data section, hex), when there, is verified if `verify`. */
CN_API CN_NODISCARD cn_status cn_bundle_open(cn_bundle **bundle, const char *path, bool verify);
CN_API uint32_t cn_bundle_count(const cn_bundle *bundle);
CN_API const cn_tensor *cn_bundle_at(const cn_bundle *bundle, uint32_t i);
CN_API const cn_tensor *cn_bundle_find(const cn_bundle *bundle, const char *name); /* NULL if absent */
CN_API const char *cn_bundle_get(const cn_bundle *bundle, const char *key);        /* NULL if absent */

/* A tile ready to render. Opaque; read-only after loading and safe to render from several threads. */
typedef struct cn_tile cn_tile;
/* n rays: where they begin, [n][3] in metres of the local frame, and their directions, [n][3] of unit length. Borrowed.
 */
typedef struct cn_ray_list {
    size_t n;
    const double (*origin_m)[3], (*direction)[3];
} cn_ray_list;
/* Opens DIR/tile.safetensors. CN_ERR_VERSION for a newer format. */
CN_API CN_NODISCARD cn_status cn_tile_open(cn_tile **tile, const char *path);
CN_API void cn_tile_close(cn_tile **tile);
CN_API const char *cn_tile_id(const cn_tile *tile);
CN_API void cn_tile_centre(const cn_tile *tile, double centre_m[3]);
CN_API double cn_tile_radius(const cn_tile *tile);
CN_API uint64_t cn_tile_bytes(const cn_tile *tile); /* memory it holds */

/* ---- appearance ----
 * The light of a render, by name: the row that a tile's effects hold for a photo (its exposure, its appearance code,
 * its sky's code; Martin-Brualla et al. 2021), the mean of all rows, or a mix. A row fits the tile that it was made
 * from only. */
#define CN_APPEARANCE_MAX 64
typedef struct cn_appearance {
    uint32_t n;
    float row[CN_APPEARANCE_MAX];
} cn_appearance;
/* The row of a photo (trained on or held out; a held-out photo's trained values are the mean), or the mean of the
 * photos trained on (photo NULL). CN_ERR_USAGE for a name that the tile does not know. */
CN_API CN_NODISCARD cn_status cn_tile_appearance(const cn_tile *tile, const char *photo, cn_appearance *appearance);
/* (1 - t) a + t b, of one tile; out may be a or b. t may leave [0, 1]. */
CN_API void cn_appearance_mix(const cn_appearance *a, const cn_appearance *b, double t, cn_appearance *out);
/* Whether the tile has a row for that photo; whether it was trained on it. */
CN_API bool cn_tile_has_photo(const cn_tile *tile, const char *photo);
CN_API bool cn_tile_trained_on(const cn_tile *tile, const char *photo);
/* Photos that it was trained on; names are the tile's. */
CN_API uint32_t cn_tile_photo_count(const cn_tile *tile);
CN_API const char *cn_tile_photo_name(const cn_tile *tile, uint32_t i);
/* Whether photos have anything of their own in this tile: without, every appearance looks the same. */
CN_API bool cn_tile_has_appearance(const cn_tile *tile);

#ifdef __cplusplus
}
#endif
#endif
