/* What a budget of seconds is best spent on, without a clock. Private to train/. */
#ifndef CONURB_TRAIN_CHOOSE_H
#define CONURB_TRAIN_CHOOSE_H
#include "conurb/train.h"

/* One candidate: the settings of a preset, and the seconds that a step of them takes here. step_s <= 0: this machine
 * has too little memory for them. */
typedef struct cn_candidate {
    cn_quality quality;
    double step_s;
    uint32_t steps;     /* that fill the budget */
    double expected_db; /* of held-out photos, beside standard's at its best, which is 0; -INFINITY where nothing is to
                           be had */
} cn_candidate;

/* Expected held-out PSNR of a preset's settings after so many steps, beside standard's at its best. */
double cn_train_expected_db(cn_quality quality, double steps);
/* Fills in steps and expected_db, and returns the best; the first of equals. */
size_t cn_train_choose_best(cn_candidate *candidates, size_t n, double budget_s);
#endif
