#include "conurb/train.h"

/* Few photos are learned by heart in a long schedule, and what lies between them gets worse: with 20,000 steps
 * sacre-coeur (8 photos) has 1.5 dB less than with 6000, sceaux (9) 0.2 less; herz-jesus (21) has 0.4 more, castle (26)
 * 0.7. So a tile has no more than so many steps a photo, but not fewer than at standard. Found on these sets at 480 px
 * (tests/bench/experiments.md). */
enum { STEPS_PER_PHOTO = 750, STANDARD_STEPS = 6000 };

cn_train_options cn_train_options_preset(cn_quality quality)
{
    cn_train_options o = {
        .seed = 1,
        .steps = STANDARD_STEPS,
        .samples_per_step = 32768,
        .leave_out_occluders = true,
        .learning_rate = 1e-2,
        .march_step = 1.0 / 128,
        .checkpoint_every_s = 60,
        .good_every = 1024,
        .validate_every_s = 20,
    };
    /* This cannot fail, because the type is in the list. */
    (void)!cn_field_options_preset("hash", quality, &o.field);
    (void)!cn_field_options_preset("hash", CN_QUALITY_PREVIEW, &o.teacher_field);
    o.teacher_steps = 1500;
    switch (quality) {
    case CN_QUALITY_PREVIEW:
        o.steps = 1500;
        o.march_step = 1.0 / 96;
        break;
    case CN_QUALITY_STANDARD:
    case CN_QUALITY_COMPACT: break;
    case CN_QUALITY_HIGH:
        o.steps = 20000;
        o.steps_per_photo = STEPS_PER_PHOTO;
        break;
    case CN_QUALITY_REFERENCE:
        o.steps = 60000;
        o.steps_per_photo = STEPS_PER_PHOTO;
        o.march_step = 1.0 / 256;
        break;
    }
    return o;
}

uint32_t cn_train_steps(const cn_train_options *options, const cn_plan_tile *tile)
{
    const uint64_t by_photos = (uint64_t)options->steps_per_photo * tile->n_photos,
                   most = by_photos > STANDARD_STEPS ? by_photos : STANDARD_STEPS;
    return options->steps_per_photo && most < options->steps ? (uint32_t)most : options->steps;
}
