/* An effect that is off costs nothing. A tile that lists it as off trains in the same memory, and to the same bytes, as
 * a tile that does not name it. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>

#include "../unit/train/synthetic.h"
#include "effect/effect.h"

#include <stdio.h>
#include <string.h>

enum { STEPS = 6 };
static synthetic_scene scene;

static int make(void **state)
{
    (void)state;
    synthetic_scene_init(&scene, 9);
    return 0;
}
static int unmake(void **state)
{
    (void)state;
    synthetic_scene_deinit(&scene);
    return 0;
}

/* Lists one effect as on (or none), and the others as off (or not at all). */
static void list_effects(const cn_effect *on, bool others_as_off)
{
    cn_plan_tile *tile = &scene.tile;
    tile->n_effects = 0;
    for (uint32_t e = 0; e < cn_effect_count; e++) {
        if (cn_effect_list[e] != on && !others_as_off) continue;
        cn_plan_effect *entry = &tile->effects[tile->n_effects++];
        memset(entry, 0, sizeof *entry);
        strcpy(entry->name, cn_effect_list[e]->name);
        entry->on = cn_effect_list[e] == on;
    }
}

/* Trains the tile with the listed effects. Gives its memory, and the path of the trained tile. */
static uint64_t train(const char *name, char path[160])
{
    cn_train_options o = synthetic_options();
    o.steps = STEPS;
    const cn_context ctx = { 0 };
    const cn_train_input input = { &scene.scene, &scene.index, scene.pixels, &scene.tile };
    cn_train_result result;
    char dir[128];
    snprintf(dir, sizeof dir, "%s/%s", scene.folder, name);
    if (cn_train_tile(&ctx, &input, &o, "parent", dir, &result) != CN_OK) fail_msg("%s", cn_error_message());
    snprintf(path, 160, "%s/tile.safetensors", dir);
    return result.arena_bytes;
}

static void test_off_is_as_if_not_there(void **state)
{
    (void)state;
    char alone[160], listed[160], name[64];
    list_effects(NULL, false);
    const uint64_t bare = train("bare", alone);
    list_effects(NULL, true);
    assert_true(train("all-off", listed) == bare);
    assert_true(same_bytes(alone, listed));
    for (uint32_t e = 0; e < cn_effect_count; e++) {
        const cn_effect *effect = cn_effect_list[e];
        list_effects(effect, false);
        snprintf(name, sizeof name, "%s-alone", effect->name);
        const uint64_t bytes = train(name, alone);
        /* Otherwise this test would compare nothing. Vignetting corrects the photos and takes no memory. */
        assert_true(bytes > bare || effect->wants_vignetting);
        list_effects(effect, true);
        snprintf(name, sizeof name, "%s-listed", effect->name);
        assert_true(train(name, listed) == bytes);
        assert_true(same_bytes(alone, listed));
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = { cmocka_unit_test(test_off_is_as_if_not_there) };
    return cmocka_run_group_tests(tests, make, unmake);
}
