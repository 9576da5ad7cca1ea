/* The best settings for a budget of seconds. No clock is read here. Private to train/. */
#ifndef CONURB_TRAIN_CHOOSE_H
#define CONURB_TRAIN_CHOOSE_H
#include "conurb/train.h"

/* One candidate: the settings of a preset, and the seconds that a step of them takes here. step_s <= 0: this machine
 * has too little memory for them. */
typedef struct cn_candidate {
    cn_quality quality;
    double step_s;
    uint32_t steps;     /* as many as the budget allows */
    double expected_db; /* held-out PSNR less the best that standard reaches; -INFINITY where it cannot be trained */
} cn_candidate;

/* Expected held-out PSNR of a preset's settings after so many steps, less the best that standard reaches. */
double cn_train_expected_db(cn_quality quality, double steps);
/* Sets steps and expected_db, and returns the index of the best candidate, or of the first of equals. */
size_t cn_train_choose_best(cn_candidate *candidates, size_t n, double budget_s);
#endif
