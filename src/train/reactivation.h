/* Occupancy reactivation: opens cells that were emptied too early. A march skips an empty cell, so the field
 * cannot learn anything in it. Ground that the long steps of the beginning missed, or that fog hid, would stay a hole.
 * A ray that meets nothing, although its photo shows no sky there, has gone through such a cell. Empty cells on this
 * ray with full neighbours are opened for a few visits. Where there is a surface it now grows. Elsewhere the cell is
 * soon empty again. (Opening all cells beside full ones costs 2.8 dB on fox.)
 *
 * A thin thing may have been emptied before a wall, too, and then its rays do meet something. So all empty cells are
 * filled again, twice, a part of them at a time, where rays have room for more samples. Near the end the corners of
 * walls are filled, so that they do not leak. Private to train/. */
#ifndef CONURB_TRAIN_REACTIVATION_H
#define CONURB_TRAIN_REACTIVATION_H
#include "field/occupancy.h"
#include "train/batch.h"
#include "train/sampler.h"

enum { CN_REACTIVATION_STEPS = 2048 /* along a ray, at most */, CN_REFILL_PARTS = 16 };

typedef struct cn_reactivation {
    uint8_t *missing; /* [CN_MAX_RAYS] the ray meets nothing where something should be */
} cn_reactivation;

void cn_reactivation_carve(cn_reactivation *reactivation, cn_arena *arena);
/* Notes the transmittance at a ray's end. sky: an effect gives a background. */
void cn_reactivation_note(cn_reactivation *reactivation, const cn_batch *batch, uint32_t ray, float after, bool sky);
/* Opens cells for the noted rays of a step. */
void cn_reactivation_open(const cn_reactivation *reactivation, const cn_batch *batch, const cn_box *box, cn_step_at at,
                          cn_occupancy *occupancy);
/* Whether, after this step, the empty cells of a part of CN_REFILL_PARTS are filled again, where there is room. */
bool cn_reactivation_refills(cn_step_at at, uint32_t *part);
/* Whether corners are filled after this step. */
bool cn_reactivation_closes(cn_step_at at);
/* Whether cells are opened at this point of the schedule. */
bool cn_reactivation_is_on(cn_step_at at);
/* The distances at which it looks for cells along a ray; returns how many of at[CN_REACTIVATION_STEPS] there are. */
uint32_t cn_reactivation_steps(const cn_box *box, float *at);
#endif
