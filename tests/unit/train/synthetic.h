/* A synthetic scene: views around coloured balls, drawn by the test itself, with every array that training wants. */
#ifndef CONURB_TESTS_SYNTHETIC_H
#define CONURB_TESTS_SYNTHETIC_H
#include "conurb/train.h"
#include "train/trainer.h"

/* Under the address sanitizer training takes minutes. So there runs are short, and what sanitizers do not change is not
 * measured: how well a field learns, how much memory it takes. */
#ifdef __SANITIZE_ADDRESS__
enum { MEASURES = 0 };
#else
enum { MEASURES = 1 };
#endif

typedef struct synthetic_scene {
    cn_photo_index index;
    cn_scene scene;
    cn_frame frame;
    cn_pixel_store *pixels;
    cn_plan_tile tile;
    char folder[64];
} synthetic_scene;
/* n photos of 48 x 36 pixels in a temporary folder; photo i is taken at exposure i % 3 - 1 stops. */
void synthetic_scene_init(synthetic_scene *synthetic, unsigned n);
/* The same with a black floor. */
void synthetic_night_init(synthetic_scene *synthetic, unsigned n);
void synthetic_scene_deinit(synthetic_scene *synthetic);
/* Options small enough for a test. */
cn_train_options synthetic_options(void);
/* Brings a zeroed trainer up to its first step, on one thread. */
void synthetic_begin(cn_trainer *trainer, const cn_context *ctx, const cn_train_input *input,
                     const cn_train_options *options);
/* True when both files have the same bytes. */
bool same_bytes(const char *a, const char *b);
#endif
