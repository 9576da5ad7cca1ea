/* What the hard cases share: float traps, a trainer that can be inspected after each step, fields of constant density,
 * and a training that is stopped in the middle. */
#ifndef CONURB_TESTS_HARD_H
#define CONURB_TESTS_HARD_H
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>

#include "../unit/train/synthetic.h"
#include "conurb/render.h"
#include "tile/model.h"
#include "train/composite.h"
#include "train/trainer.h"

/* Between these an invalid operation, a division by zero or an overflow of floats ends the test by SIGFPE, at the place
 * where it happens. For the calling thread. */
void hard_traps_on(void);
void hard_traps_off(void);

/* Fails the test with the library's message. */
void hard_must(cn_status status);

/* A scene of n photos at 48 x 36, all of them for training, and the smallest field. */
void hard_scene_init(synthetic_scene *synthetic, unsigned n);
cn_train_options hard_options(void);
/* Paints the photos anew, as EXR in linear ACEScg: rgb of photo i at (x, y). */
typedef void (*hard_paint)(unsigned photo, uint32_t x, uint32_t y, float rgb[3]);
void hard_repaint(synthetic_scene *synthetic, hard_paint paint);
/* Turns effects on, by name; the list ends with NULL. */
void hard_effects(synthetic_scene *synthetic, ...);

/* A trainer before its first step. It works on the calling thread only. kernel NULL: the best one. */
typedef struct hard_run {
    cn_context ctx;
    cn_train_input input;
    cn_trainer t;
} hard_run;
void hard_run_init(hard_run *run, const synthetic_scene *synthetic, const cn_train_options *options,
                   const cn_kernel *kernel);
void hard_run_deinit(hard_run *run);
/* The field has this density logit everywhere, and colour 1. */
void hard_fill(hard_run *run, float logit);
/* To be called after that one: sets another colour, where the logit is positive. */
void hard_colour(hard_run *run, float logit, float colour);
/* Checks that every parameter and every second moment is finite. */
bool hard_finite(const hard_run *run);
/* The present field as an opened tile. All its cells are occupied. step: of its march. */
cn_tile *hard_tile(hard_run *run, const synthetic_scene *synthetic, double step);

/* Does two steps, then the same two from a checkpoint made before them. Both give the same bytes. */
void hard_resume(hard_run *run, const synthetic_scene *synthetic);

/* Trains in one go, and again stopped in the middle and resumed: both end with the same bytes. Tells where the tile is,
 * and of the run in one go what its metrics say. */
typedef struct hard_trained {
    char tile[160];
    double psnr, bad_rays, returns;
} hard_trained;
hard_trained hard_train(const synthetic_scene *synthetic, const cn_train_options *options);
#endif
