/* Multi-view support: which photos show a place. Matter that only one photo shows has a small cost. Private to train/.
 */
#ifndef CONURB_TRAIN_SUPPORT_H
#define CONURB_TRAIN_SUPPORT_H
#include "conurb/pose.h"
#include "train/checkpoint.h"
#include "train/worker.h"

enum { CN_SUPPORT_CELLS = 1 << 22 };
typedef struct cn_support {
    float *photo;    /* [CN_SUPPORT_CELLS] the photo that saw a cell last; NULL where no effect asks for support */
    float *since;    /* the last step in which it was another one */
    float *times;    /* how often it saw the cell since then */
    uint32_t *visit; /* [lanes] the cell of every sample of the step */
    uint32_t n_photos;
} cn_support;

void cn_support_carve(cn_support *support, cn_arena *arena, size_t lanes);
/* Marks places around sparse points as supported, because two photos agree on each point. */
void cn_support_begin(cn_support *support, const cn_scene *scene, const cn_box *box);
void cn_support_list(const cn_support *support, cn_checkpoint *checkpoint);
/* The cell of a place in contracted space, 0 to 1. */
uint32_t cn_support_cell(float x, float y, float z);
/* Notes the cells of a group's samples, before the live ones move together. */
void cn_support_note(cn_support *support, const cn_batch *batch, uint32_t group);
/* Notes what the rays of a group have seen in this step. */
void cn_support_update(cn_support *support, const cn_batch *batch, uint32_t step, uint32_t group);
/* Steps for which a second photo's look at a cell counts. */
float cn_support_remembered(const cn_support *support);
/* Marks the single-view samples of a ray (worker->single_view). cell: those of the group's samples. */
void cn_support_mark(const cn_support *support, const uint32_t *cell, uint32_t step, const cn_span *span,
                     cn_worker *worker);
#endif
