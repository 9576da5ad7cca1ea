/* Any bytes as a training checkpoint. The length of its header is made from the first two bytes. In a checkpoint that
 * is accepted, all that a step depends on is finite. */
#include "../unit/field/options.h"
#include "fuzz.h"

#include "train/trainer.h"

#include <math.h>

static cn_trainer trainer;

static void set_up(void)
{
    static cn_plan_tile tile = { .id = "x",
                                 .radius_m = 1,
                                 .bounds_min = { -1, -1, -1 },
                                 .bounds_max = { 1, 1, 1 },
                                 .near_m = 0.1,
                                 .far_m = 10,
                                 .n_photos = 2 };
    static const cn_train_input input = { .tile = &tile };
    cn_train_options options = cn_train_options_preset(CN_QUALITY_PREVIEW);
    cn_arena counter;
    field_set(&options.field, "levels", 1);
    field_set(&options.field, "log2_table", 8);
    options.samples_per_step = 4096;
    cn_arena_count(&counter);
    if (cn_trainer_plan(&trainer, &input, &options, 1) != CN_OK) abort();
    cn_trainer_carve(&trainer, &counter);
    if (cn_arena_init(&trainer.arena, counter.used) != CN_OK) abort();
    cn_trainer_carve(&trainer, &trainer.arena);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    if (!trainer.arena.size) set_up();
    /* An empty input means a valid checkpoint, so that the corpus needs no large file. */
    char path[160];
    bool resumed = false;
    if (size < 2) {
        snprintf(path, sizeof path, "%s/whole", fuzz_home());
        trainer.sampler.pace.samples_per_group = 64, trainer.sampler.pace.march_step = 0.1;
        if (cn_trainer_save_checkpoint(&trainer, "key", path) != CN_OK) abort();
        if (cn_trainer_load_checkpoint(&trainer, "key", path, &resumed) != CN_OK || !resumed) abort();
        return 0;
    }
    const uint64_t length = data[0] | (uint64_t)data[1] << 8;
    uint8_t *bytes = malloc(size + 6);
    memcpy(bytes, &length, 8);
    memcpy(bytes + 8, data + 2, size - 2);
    snprintf(path, sizeof path, "%s", fuzz_file("checkpoint.safetensors", bytes, size + 6));
    free(bytes);
    if (cn_trainer_load_checkpoint(&trainer, "key", path, &resumed) == CN_OK && resumed &&
        !(isfinite(trainer.sampler.pace.samples_per_group) && trainer.sampler.pace.samples_per_group >= 1 &&
          isfinite(trainer.sampler.pace.march_step)))
        abort();
    return 0;
}
