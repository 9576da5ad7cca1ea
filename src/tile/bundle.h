/* What the writer and the reader of safetensors files share. */
#ifndef CONURB_TILE_BUNDLE_H
#define CONURB_TILE_BUNDLE_H
#include "conurb/tile.h"

/* The limit of the reference implementation. A larger header is damaged or hostile. */
#define CN_BUNDLE_HEADER_MAX (UINT64_C(100) << 20)
#define CN_BUNDLE_ALIGN 64
#define CN_BUNDLE_DIMS_MAX 4
/* Far above what a tile needs. They limit the work that a hostile header can cause. */
#define CN_BUNDLE_TENSORS_MAX 65536
#define CN_BUNDLE_PAIRS_MAX 4096
#define CN_BUNDLE_CHECKSUM "checksum"

typedef struct cn_bundle_pair {
    char *key, *value;
} cn_bundle_pair;

struct cn_bundle {
    cn_tensor *tensors;
    uint32_t n_tensors, tensor_room;
    cn_bundle_pair *pairs;
    uint32_t n_pairs, pair_room;
    /* For a file that is open for reading; else map is NULL. */
    void *map;
    size_t map_size;
    void **copies;
    uint32_t n_copies; /* aligned copies of tensors that a foreign file left misaligned */
};

/* Name in the file, "F32". */
const char *cn_dtype_name(cn_dtype dtype);
bool cn_dtype_from_name(const char *name, cn_dtype *dtype);
/* Bytes of the tensor; false when the number needs more than 63 bits. */
bool cn_tensor_bytes(const cn_tensor *tensor, uint64_t *bytes);
#endif
