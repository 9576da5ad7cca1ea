/* Checkpoints: named arrays that the parts of a trainer list, written and read as one file. Private to train/. */
#ifndef CONURB_TRAIN_CHECKPOINT_H
#define CONURB_TRAIN_CHECKPOINT_H
#include "conurb/base.h"
#include "tile/bundle.h"

#include <stdbool.h>

enum { CN_CHECKPOINT_ARRAYS = 24 };
typedef struct cn_checkpoint_array {
    const char *name;
    cn_dtype dtype;
    size_t n;
    void *data;                      /* borrowed */
    bool (*valid)(const void *data); /* of a checkpoint that can be continued; NULL: any */
} cn_checkpoint_array;
typedef struct cn_checkpoint {
    cn_checkpoint_array array[CN_CHECKPOINT_ARRAYS];
    uint32_t n;
} cn_checkpoint;

/* Lists n values at data. The name must have static storage. With n 0 nothing is listed. */
void cn_checkpoint_add(cn_checkpoint *checkpoint, const char *name, cn_dtype dtype, size_t n, void *data);
CN_NODISCARD cn_status cn_checkpoint_save(const cn_checkpoint *checkpoint, const char *key, const char *path);
/* Reads the file into the listed arrays, if it was made with this key; *loaded says whether it was. CN_ERR_FORMAT when
 * an array is missing or has another size; then no array was changed. */
CN_NODISCARD cn_status cn_checkpoint_load(const cn_checkpoint *checkpoint, const char *key, const char *path,
                                          bool *loaded);
#endif
