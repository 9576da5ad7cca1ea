/* A made scene: views around coloured balls, drawn by the test itself, with every array that training wants. */
#ifndef CONURB_TESTS_MADE_H
#define CONURB_TESTS_MADE_H
#include "conurb/train.h"

typedef struct made_scene {
    cn_photo_index index;
    cn_scene scene;
    cn_frame frame;
    cn_pixel_store *pixels;
    cn_plan_tile tile;
    char folder[64];
} made_scene;
/* n photos of 48 x 36 pixels in a temporary folder; photo i is taken at exposure i % 3 - 1 stops. */
void made_scene_init(made_scene *made, unsigned n);
void made_scene_deinit(made_scene *made);
/* Options small enough for a test. */
cn_train_options made_options(void);
/* True when both files have the same bytes. */
bool same_bytes(const char *a, const char *b);
#endif
