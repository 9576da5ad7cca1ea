/* The field and all trained parameters: how they are stored, encoded and updated, whatever the field's type is. Private
 * to train/. */
#ifndef CONURB_TRAIN_PARAMETERS_H
#define CONURB_TRAIN_PARAMETERS_H
#include "base/arena.h"
#include "field/field.h"
#include "train/batch.h"
#include "train/checkpoint.h"

typedef struct cn_parameters {
    cn_field field;
    uint16_t *table,
        *table_state; /* as cn_kernel.adam_table has them; a section's state begins at a block of its own */
    size_t table_n, state_n;
    uint32_t section_parts; /* the update of a section is split in so many items, a power of two */
    /* Float parameters: the field's weights, the photos' rows of effects, the effects' shared parameters. */
    float *value, *grad;
    size_t n, photo_at, shared_at; /* all of them; where the photos' rows and the shared parameters begin */
    float *derived;                /* what the field derives from its weights */
} cn_parameters;

/* Gradients of a part of a section, and which entries have one. All zero between uses. Each thread has its own. */
typedef struct cn_part_scratch {
    float *grad;
    uint8_t *touched;
} cn_part_scratch;

/* Sets the sizes for so many floats of the photos' rows and of shared parameters, and so many threads. The field must
 * be laid out. */
void cn_parameters_size(cn_parameters *p, size_t n_photo, size_t n_shared, unsigned threads);
void cn_parameters_carve(cn_parameters *p, cn_arena *arena);
void cn_parameters_carve_scratch(const cn_parameters *p, cn_arena *arena, cn_part_scratch *scratch);
/* Sets the first values of the field. Those of the effects are not changed. */
CN_NODISCARD cn_status cn_parameters_init(cn_parameters *p, uint64_t seed);
/* For cn_field_type.place and adapt, whose other members the caller fills. Entries that get new values lose Adam's
 * moments. */
cn_field_change cn_parameters_change(cn_parameters *p, uint64_t seed, uint32_t step);
/* Call it after the values have changed. */
void cn_parameters_derive(cn_parameters *p);
cn_field_params cn_parameters_view(const cn_parameters *p);
bool cn_parameters_finite(const cn_parameters *p);
void cn_parameters_list(const cn_parameters *p, cn_checkpoint *checkpoint);

/* Numbers of work items that threads share: for encoding the batch, and for updating the table. */
size_t cn_parameters_encode_items(const cn_parameters *p);
void cn_parameters_encode(const cn_parameters *p, const cn_kernel *kernel, size_t item, cn_batch *batch);
size_t cn_parameters_update_items(const cn_parameters *p);
/* Computes the gradients of one item's entries from those of the encodings in batch->enc, and applies Adam. */
void cn_parameters_update(cn_parameters *p, const cn_kernel *kernel, size_t item, const cn_batch *batch,
                          const cn_adam *adam, cn_part_scratch *scratch);
/* Adam's packed state of a section. */
uint16_t *cn_parameters_state(const cn_parameters *p, uint32_t section);
#endif
