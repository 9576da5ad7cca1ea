/* Trains every type of field in the list on the synthetic scene. The number of threads changes no byte. A stopped run
 * ends like an uninterrupted one. Its tile is read back whole. And it learns. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>

#include "../unit/train/synthetic.h"
#include "base/file.h"
#include "base/json.h"
#include "conurb/render.h"
#include "effect/effect.h"
#include "small.h"
#include "tile/model.h"

#include <stdio.h>

/* A stopped run is stopped after 24 steps. */
enum { STEPS = MEASURES ? 40 : 28 };

static synthetic_scene synthetic;

static int make(void **state)
{
    (void)state;
    synthetic_scene_init(&synthetic, 17);
    return 0;
}
static int unmake(void **state)
{
    (void)state;
    synthetic_scene_deinit(&synthetic);
    return 0;
}

/* Every effect of the list, or none. */
static void turn_effects(bool on)
{
    synthetic.tile.n_effects = 0;
    for (uint32_t i = 0; on && i < cn_effect_count; i++) {
        cn_plan_effect *e = &synthetic.tile.effects[synthetic.tile.n_effects++];
        memset(e, 0, sizeof *e);
        strcpy(e->name, cn_effect_list[i]->name);
        e->on = true;
    }
}

static cn_train_options options_of(const cn_field_type *type, uint32_t steps)
{
    cn_train_options o = synthetic_options();
    o.field = small_field(type, 64);
    o.steps = steps;
    o.samples_per_step = 4096; /* the least there may be */
    o.teacher_field = small_field(cn_field_type_find("hash"), 64);
    o.teacher_steps = 20;
    return o;
}

typedef struct trained {
    char folder[128], tile[160];
    cn_train_result result;
} trained;

static cn_status train(const cn_context *ctx, const cn_train_options *o, const char *name, trained *t)
{
    const cn_train_input input = { &synthetic.scene, &synthetic.index, synthetic.pixels, &synthetic.tile };
    snprintf(t->folder, sizeof t->folder, "%s/%s", synthetic.folder, name);
    snprintf(t->tile, sizeof t->tile, "%s/%s/tile.safetensors", synthetic.folder, name);
    return cn_train_tile(ctx, &input, o, "parent", t->folder, &t->result);
}

static void train_whole(unsigned threads, const cn_train_options *o, const char *name, trained *t)
{
    cn_pool *pool = NULL;
    assert_int_equal(cn_pool_create(&pool, threads), CN_OK);
    const cn_context ctx = { .pool = pool };
    if (train(&ctx, o, name, t) != CN_OK) fail_msg("%s: %s", o->field.type, cn_error_message());
    cn_pool_destroy(&pool);
}

/* The run of STEPS steps that others are compared with, by one thread. It is trained once, with effects or without. */
static const trained *whole_run(const cn_field_type *type, bool effects)
{
    static trained runs[16][2];
    uint32_t i = 0;
    assert_true(cn_field_n_types <= 16);
    while (cn_field_types[i] != type)
        i++;
    trained *t = &runs[i][effects];
    if (t->folder[0]) return t;
    const cn_train_options o = options_of(type, STEPS);
    char name[64];
    snprintf(name, sizeof name, "%s-whole-%d", type->name, effects);
    turn_effects(effects);
    train_whole(1, &o, name, t);
    return t;
}

static int stop_flag;
static void stop_soon(void *user, const cn_progress_report *r)
{
    (void)user;
    if (r->done >= 24) cn_stop(&stop_flag);
}

/* Leaves a checkpoint of a run that was stopped. */
static void train_part(const cn_train_options *o, const char *name, trained *t)
{
    char path[160];
    const cn_context ctx = { .progress = stop_soon, .stop = &stop_flag };
    assert_int_equal(train(&ctx, o, name, t), CN_ERR_INTERRUPTED);
    stop_flag = 0;
    snprintf(path, sizeof path, "%s/checkpoint.safetensors", t->folder);
    assert_true(cn_file_exists(path));
    assert_false(cn_file_exists(t->tile));
}

static void test_threads_change_nothing(void **state)
{
    (void)state;
    turn_effects(true);
    for (uint32_t i = 0; i < cn_field_n_types; i++) {
        const cn_field_type *type = cn_field_types[i];
        cn_train_options o = options_of(type, STEPS);
        const trained *one = whole_run(type, true);
        trained other;
        char name[64];
        snprintf(name, sizeof name, "%s-threads", type->name);
        train_whole(3, &o, name, &other);
        if (!same_bytes(one->tile, other.tile))
            fail_msg("%s: other bytes with three threads than with one", type->name);
        o.seed = 2;
        snprintf(name, sizeof name, "%s-seed", type->name);
        train_whole(2, &o, name, &other);
        assert_false(same_bytes(one->tile, other.tile)); /* otherwise the comparison could not fail */
    }
}

/* With every effect and with none. */
static void test_resume_gives_the_same_bytes(void **state)
{
    (void)state;
    for (uint32_t i = 0; i < cn_field_n_types; i++)
        for (int on = 0; on < 2; on++) {
            const cn_field_type *type = cn_field_types[i];
            const cn_train_options o = options_of(type, STEPS);
            const trained *whole = whole_run(type, on);
            trained parts;
            char name[64];
            turn_effects(on);
            snprintf(name, sizeof name, "%s-parts-%d", type->name, on);
            train_part(&o, name, &parts);
            train_whole(2, &o, name, &parts);
            if (!same_bytes(whole->tile, parts.tile))
                fail_msg("%s, effects %s: a resumed run ends with other bytes", type->name, on ? "on" : "off");
        }
}

/* Changes the value of one setting; of one that changes no size, where the type has such a setting. */
static cn_train_options changed_options(const cn_train_options *o)
{
    const cn_field_type *type = cn_field_type_find(o->field.type);
    cn_train_options changed = *o;
    for (uint32_t i = 0; i < type->n_options; i++) {
        cn_field before, after;
        changed = *o;
        changed.field.value[i] = other_value(&type->options[i], o->field.value[i]);
        assert_int_equal(cn_field_layout(&before, &o->field, (cn_field_inputs){ 0 }), CN_OK);
        assert_int_equal(cn_field_layout(&after, &changed.field, (cn_field_inputs){ 0 }), CN_OK);
        if (before.entries == after.entries && before.n_weights == after.n_weights) break;
    }
    return changed;
}

/* A checkpoint of another type, or of other settings of the type, is not continued. */
static void test_other_fields_start_anew(void **state)
{
    (void)state;
    turn_effects(false);
    for (uint32_t i = 0; i < cn_field_n_types; i++) {
        const cn_field_type *type = cn_field_types[i], *next = cn_field_types[(i + 1) % cn_field_n_types];
        const cn_train_options o = options_of(type, STEPS), other = options_of(next, STEPS);
        const trained *fresh = whole_run(type, false);
        trained after;
        char name[64];
        snprintf(name, sizeof name, "%s-after", type->name);
        if (next != type) {
            train_part(&other, name, &after);
            train_whole(2, &o, name, &after);
            if (!same_bytes(fresh->tile, after.tile)) fail_msg("%s after %s: other bytes", type->name, next->name);
        }
        if (!type->n_options) continue;
        const cn_train_options changed = changed_options(&o);
        snprintf(name, sizeof name, "%s-after-itself", type->name);
        train_part(&changed, name, &after);
        train_whole(2, &o, name, &after);
        if (!same_bytes(fresh->tile, after.tile))
            fail_msg("%s: a checkpoint of other settings was taken up", type->name);
    }
}

static void save_again(const cn_tile *tile, uint32_t steps, const char *path)
{
    const cn_tile_parts parts = {
        .id = tile->id,
        .parent_hash = "parent",
        .radius_m = tile->radius_m,
        .box = &tile->box,
        .field = &tile->field,
        .table = (const uint16_t *)(const void *)tile->params.table,
        .weights = tile->params.weights,
        .occupancy = tile->occupancy,
        .seen = tile->seen.places ? &tile->seen : NULL,
        .pack = &tile->pack,
        .names = (const char *const *)tile->names,
        .n_names = tile->n_names,
        .n_trained = tile->n_trained,
        .constants = tile->constants,
        .effect_params = tile->effect_params,
        .shared = tile->shared,
        .steps = steps,
    };
    if (cn_tile_save(&parts, path) != CN_OK) fail_msg("%s", cn_error_message());
}

/* Every block is a tensor of the file. */
static void has_blocks(const cn_field *field, const char *path)
{
    cn_bundle *bundle = NULL;
    assert_int_equal(cn_bundle_open(&bundle, path, true), CN_OK);
    for (uint32_t b = 0; b < field->n_blocks; b++) {
        const cn_tensor *tensor = cn_bundle_find(bundle, field->block[b].name);
        if (!tensor) fail_msg("%s has no %s", path, field->block[b].name);
        assert_int_equal(tensor->dtype, field->block[b].storage == CN_FIELD_TABLE ? CN_BF16 : CN_F32);
        assert_int_equal(tensor->n_dims, 2);
        assert_memory_equal(tensor->dims, field->block[b].dims, sizeof field->block[b].dims);
    }
    cn_bundle_destroy(&bundle);
}

static void test_tile_is_read_back(void **state)
{
    (void)state;
    for (uint32_t i = 0; i < cn_field_n_types; i++) {
        const cn_field_type *type = cn_field_types[i];
        const cn_train_options o = options_of(type, STEPS);
        const trained *t = whole_run(type, true);
        char again[160];
        cn_tile *tile = NULL;
        if (cn_tile_open(&tile, t->tile) != CN_OK) fail_msg("%s: %s", type->name, cn_error_message());
        assert_ptr_equal(tile->field.type, type);
        for (uint32_t s = 0; s < type->n_options; s++)
            assert_true(tile->field.options.value[s] == o.field.value[s]);
        has_blocks(&tile->field, t->tile);
        assert_true(cn_tile_bytes(tile) >= cn_field_options_bytes(&o.field));
        snprintf(again, sizeof again, "%s/again.safetensors", t->folder);
        save_again(tile, o.steps, again);
        if (!same_bytes(t->tile, again)) fail_msg("%s: other bytes after opening and saving", type->name);
        cn_tile_close(&tile);
    }
}

/* Copies a tile and changes its description: "field" gets this type, or none. */
static void copy_with_type(const char *from, const char *type, const char *to)
{
    cn_bundle *in = NULL, *out = NULL;
    assert_int_equal(cn_bundle_open(&in, from, true), CN_OK);
    assert_int_equal(cn_bundle_create(&out), CN_OK);
    for (uint32_t i = 0; i < cn_bundle_count(in); i++) {
        const cn_tensor *t = cn_bundle_at(in, i);
        assert_int_equal(cn_bundle_add(out, t->name, t->dtype, t->n_dims, t->dims, t->data), CN_OK);
    }
    json_t *root = json_loads(cn_bundle_get(in, "conurb.tile"), 0, NULL), *field = json_object_get(root, "field");
    assert_non_null(field);
    if (type)
        json_object_set_new(field, "type", json_string(type));
    else
        assert_int_equal(json_object_del(field, "type"), 0);
    char *text = json_dumps(root, JSON_COMPACT);
    assert_int_equal(cn_bundle_set(out, "conurb.tile", text), CN_OK);
    assert_int_equal(cn_bundle_write(out, to), CN_OK);
    free(text);
    json_decref(root);
    cn_bundle_destroy(&out);
    cn_bundle_destroy(&in);
}

static void refused(const char *path, cn_status expected)
{
    cn_tile *tile = NULL;
    assert_int_equal(cn_tile_open(&tile, path), expected);
    assert_null(tile);
    assert_non_null(strstr(cn_error_message(), path));
    assert_null(strchr(cn_error_message(), '\n'));
}

/* A tile from before there were types has no field.type. It is a hash grid. A tile is refused with one line when its
 * type is not in the list, or does not fit its tensors. */
static void test_tile_says_its_type(void **state)
{
    (void)state;
    for (uint32_t i = 0; i < cn_field_n_types; i++) {
        const cn_field_type *type = cn_field_types[i];
        const trained *t = whole_run(type, false);
        char path[160];
        snprintf(path, sizeof path, "%s/other.safetensors", t->folder);
        copy_with_type(t->tile, NULL, path);
        if (strcmp(type->name, "hash") == 0) {
            cn_tile *tile = NULL;
            if (cn_tile_open(&tile, path) != CN_OK) fail_msg("%s", cn_error_message());
            assert_ptr_equal(tile->field.type, type);
            cn_tile_close(&tile);
        } else {
            refused(path, CN_ERR_FORMAT);
        }
        copy_with_type(t->tile, "none such", path);
        refused(path, CN_ERR_VERSION);
        assert_non_null(strstr(cn_error_message(), "none such"));
        for (uint32_t other = 0; other < cn_field_n_types; other++) {
            if (other == i) continue;
            copy_with_type(t->tile, cn_field_types[other]->name, path);
            refused(path, CN_ERR_FORMAT);
        }
    }
}

static void render(const char *path, unsigned threads, cn_picture *picture)
{
    cn_tile *tile = NULL;
    cn_pool *pool = NULL;
    assert_int_equal(cn_tile_open(&tile, path), CN_OK);
    assert_int_equal(cn_pool_create(&pool, threads), CN_OK);
    assert_int_equal(cn_picture_init(picture, 48, 36), CN_OK);
    const cn_context ctx = { .pool = pool };
    const cn_render_options o = cn_render_options_default();
    const cn_view *view = &synthetic.scene.views[synthetic.tile.held_out[0]];
    assert_int_equal(cn_render_tile(&ctx, tile, &synthetic.scene.cameras[0], view, &o, picture), CN_OK);
    cn_pool_destroy(&pool);
    cn_tile_close(&tile);
}

/* The PSNR is better than after a few steps, and better than that of one colour for all pixels (about 8 dB). A render
 * gives the same bits with any number of threads. */
static void test_learns(void **state)
{
    (void)state;
    if (!MEASURES) skip();
    turn_effects(false);
    for (uint32_t i = 0; i < cn_field_n_types; i++) {
        const cn_field_type *type = cn_field_types[i];
        trained early, late;
        cn_train_options o = options_of(type, 24);
        char name[64];
        snprintf(name, sizeof name, "%s-early", type->name);
        train_whole(2, &o, name, &early);
        o.steps = 250;
        snprintf(name, sizeof name, "%s-late", type->name);
        train_whole(2, &o, name, &late);
        print_message("%s: %.2f dB after 24 steps, %.2f after 250\n", type->name, early.result.train_psnr,
                      late.result.train_psnr);
        assert_true(late.result.train_psnr > early.result.train_psnr + 2);
        cn_picture one, three;
        render(late.tile, 1, &one);
        render(late.tile, 3, &three);
        assert_memory_equal(one.rgba, three.rgba, sizeof(float) * 4 * 48 * 36);
        for (size_t p = 0; p < 4 * 48 * 36; p++)
            assert_true(isfinite(one.rgba[p]));
        cn_picture_deinit(&one);
        cn_picture_deinit(&three);
    }
}

/* A run takes as much memory as the plan says. */
static void test_memory_is_as_planned(void **state)
{
    (void)state;
    if (!MEASURES) skip();
    turn_effects(true);
    for (uint32_t i = 0; i < cn_field_n_types; i++) {
        const cn_train_options o = options_of(cn_field_types[i], 24);
        const cn_context ctx = { 0 };
        cn_train_speed *speed = NULL;
        double seconds;
        uint64_t bytes;
        trained t;
        char name[64];
        snprintf(name, sizeof name, "%s-memory", o.field.type);
        assert_int_equal(cn_train_speed_create(&speed, NULL), CN_OK);
        assert_int_equal(cn_train_speed_predict(&ctx, speed, &o, &synthetic.tile, &seconds, &bytes), CN_OK);
        cn_train_speed_destroy(&speed);
        assert_int_equal(train(&ctx, &o, name, &t), CN_OK);
        assert_int_equal(bytes, t.result.arena_bytes);
    }
}

static void refuses_teacher(const char *teacher, const char *says)
{
    const cn_context ctx = { 0 };
    cn_train_options o = options_of(cn_field_type_find("kilo"), 24);
    trained t;
    o.teacher = teacher;
    assert_true(train(&ctx, &o, "kilo-refuses", &t) != CN_OK);
    if (!strstr(cn_error_message(), says)) fail_msg("%s", cn_error_message());
    assert_null(strchr(cn_error_message(), '\n'));
    assert_false(cn_file_exists(t.tile));
}

/* A teacher is trained first and kept beside the tile. Named, it gives the same bytes. One of other photos or effects
 * is refused. What a field learned from it is more than it learns from photos in as many steps. */
static void test_teacher(void **state)
{
    (void)state;
    turn_effects(true);
    cn_train_options o = options_of(cn_field_type_find("kilo"), STEPS);
    trained alone, named;
    char teacher[192];
    train_whole(2, &o, "kilo-alone", &alone);
    snprintf(teacher, sizeof teacher, "%s/teacher/tile.safetensors", alone.folder);
    assert_true(cn_file_exists(teacher));
    o.teacher = teacher;
    train_whole(2, &o, "kilo-named", &named);
    assert_true(same_bytes(alone.tile, named.tile));
    assert_int_equal(cn_field_options_set(&o.field, "distilled", 0), CN_OK);
    train_whole(2, &o, "kilo-untaught", &named);
    assert_false(same_bytes(alone.tile, named.tile));

    refuses_teacher("/there/is/none", "/there/is/none: there is no such teacher");
    turn_effects(false);
    refuses_teacher(teacher, "other effects");
    turn_effects(true);
    synthetic.tile.n_photos--;
    refuses_teacher(teacher, "other photos");
    synthetic.tile.n_photos++;
    synthetic.tile.bounds_max[2] += 1;
    refuses_teacher(teacher, "other bounds");
    synthetic.tile.bounds_max[2] -= 1;
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_threads_change_nothing),  cmocka_unit_test(test_resume_gives_the_same_bytes),
        cmocka_unit_test(test_other_fields_start_anew), cmocka_unit_test(test_tile_is_read_back),
        cmocka_unit_test(test_tile_says_its_type),      cmocka_unit_test(test_learns),
        cmocka_unit_test(test_memory_is_as_planned),    cmocka_unit_test(test_teacher),
    };
    return cmocka_run_group_tests(tests, make, unmake);
}
