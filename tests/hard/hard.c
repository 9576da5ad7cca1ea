#include "hard.h"

#include "base/file.h"
#include "base/json.h"
#include "bridge/oiio.h"

#include <fenv.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { WIDTH = 48, HEIGHT = 36 };

void hard_traps_on(void)
{
    feclearexcept(FE_ALL_EXCEPT);
    feenableexcept(FE_INVALID | FE_DIVBYZERO | FE_OVERFLOW);
}

void hard_traps_off(void)
{
    fedisableexcept(FE_ALL_EXCEPT);
    feclearexcept(FE_ALL_EXCEPT);
}

void hard_must(cn_status status)
{
    if (status != CN_OK) fail_msg("%s", cn_error_message());
}

void hard_scene_init(synthetic_scene *synthetic, unsigned n)
{
    synthetic_scene_init(synthetic, n);
    synthetic->tile.n_photos = n;
    synthetic->tile.n_held_out = 0;
    for (unsigned i = 0; i < n; i++)
        synthetic->tile.photos[i] = i;
}

cn_train_options hard_options(void)
{
    cn_train_options o = synthetic_options();
    o.samples_per_step = 4096;
    o.steps = 32;
    return o;
}

void hard_repaint(synthetic_scene *synthetic, hard_paint paint)
{
    const cn_context quiet = { 0 };
    float *rgba = malloc(sizeof *rgba * WIDTH * HEIGHT * 4);
    char *store = cn_path_join(synthetic->folder, "painted.bin"), *folder = cn_path_join(synthetic->folder, "painted");
    assert_true(rgba && store && folder);
    hard_must(cn_folder_make(folder));
    for (unsigned i = 0; i < synthetic->scene.n_views; i++) {
        char *path = cn_format("%s/%03u.exr", folder, i);
        for (uint32_t p = 0; p < WIDTH * HEIGHT; p++) {
            paint(i, p % WIDTH, p / WIDTH, rgba + 4 * (size_t)p);
            rgba[4 * (size_t)p + 3] = 1;
        }
        hard_must(cn_oiio_write_exr(path, rgba, NULL, WIDTH, HEIGHT, NULL));
        free(path);
        free(synthetic->scene.views[i].name);
        synthetic->scene.views[i].name = cn_format("%03u.exr", i);
    }
    double exposure[64];
    for (unsigned i = 0; i < synthetic->index.n_photos; i++)
        exposure[i] = synthetic->index.photos[i].exposure_s;
    cn_photo_index_deinit(&synthetic->index);
    cn_pixel_store_close(&synthetic->pixels);
    hard_must(cn_photo_index_scan(&quiet, folder, &synthetic->index));
    assert_int_equal(synthetic->index.n_photos, synthetic->scene.n_views); /* only one of equal photos would be kept */
    for (unsigned i = 0; i < synthetic->index.n_photos; i++)
        synthetic->index.photos[i].exposure_s = exposure[i];
    hard_must(cn_pixel_store_build(&quiet, &synthetic->index, WIDTH, store));
    hard_must(cn_pixel_store_open(&synthetic->pixels, store));
    free(folder);
    free(store);
    free(rgba);
}

void hard_effects(synthetic_scene *synthetic, ...)
{
    va_list names;
    va_start(names, synthetic);
    synthetic->tile.n_effects = 0;
    for (const char *name; (name = va_arg(names, const char *));) {
        cn_plan_effect *e = &synthetic->tile.effects[synthetic->tile.n_effects++];
        memset(e, 0, sizeof *e);
        snprintf(e->name, sizeof e->name, "%s", name);
        e->on = true;
    }
    va_end(names);
}

void hard_run_init(hard_run *run, const synthetic_scene *synthetic, const cn_train_options *options,
                   const cn_kernel *kernel)
{
    cn_arena counter;
    memset(run, 0, sizeof *run);
    run->input = (cn_train_input){ &synthetic->scene, &synthetic->index, synthetic->pixels, &synthetic->tile };
    run->t.ctx = &run->ctx;
    cn_arena_count(&counter);
    hard_must(cn_trainer_plan(&run->t, &run->input, options, 1));
    if (kernel) run->t.kernel = kernel;
    cn_trainer_carve(&run->t, &counter);
    hard_must(cn_arena_init(&run->t.arena, counter.used));
    cn_trainer_carve(&run->t, &run->t.arena);
    hard_must(cn_trainer_begin(&run->t));
}

void hard_run_deinit(hard_run *run)
{
    cn_trainer_deinit(&run->t);
}

/* Every table entry is 1, and so is every encoding. Eight of them give the first hidden unit, which gives the logit. */
void hard_fill(hard_run *run, float logit)
{
    cn_trainer *t = &run->t;
    const cn_layer *first = &t->parameters.field.mlp.layer[CN_LAYER_DENSITY0],
                   *second = &t->parameters.field.mlp.layer[CN_LAYER_DENSITY1];
    assert_true(first->in >= 8);
    for (size_t i = 0; i < t->parameters.table_n; i++)
        t->parameters.table[i] = 0x3f80;
    memset(t->parameters.table_state, 0, t->parameters.state_n * sizeof *t->parameters.table_state);
    memset(t->parameters.value, 0, t->parameters.photo_at * sizeof *t->parameters.value);
    memset(t->optimiser.m, 0, t->parameters.n * sizeof *t->optimiser.m);
    memset(t->optimiser.v, 0, t->parameters.n * sizeof *t->optimiser.v);
    for (int i = 0; i < 8; i++)
        t->parameters.value[first->offset + (size_t)i] = 0.125f;
    t->parameters.value[second->offset] = logit;
    cn_parameters_derive(&t->parameters);
    cn_occupancy_reset(&t->occ, t->usable);
    memset(&t->monitor, 0, sizeof t->monitor);
    t->step = 0;
}

void hard_colour(hard_run *run, float logit, float colour)
{
    cn_trainer *t = &run->t;
    const cn_layer *layer = &t->parameters.field.mlp.layer[CN_LAYER_COLOUR0];
    t->parameters.value[layer[0].offset] = 1 / logit;
    t->parameters.value[layer[1].offset] = 1;
    for (size_t c = 0; c < 3; c++)
        t->parameters.value[layer[2].offset + c * layer[2].in] = colour;
    cn_parameters_derive(&t->parameters);
}

bool hard_finite(const hard_run *run)
{
    const cn_trainer *t = &run->t;
    bool finite = cn_parameters_finite(&t->parameters);
    for (size_t i = 0; i < t->parameters.n; i++)
        finite &= isfinite(t->optimiser.m[i]) && isfinite(t->optimiser.v[i]);
    for (uint32_t l = 0; l < t->parameters.field.n_sections; l++)
        for (size_t i = 0; i < 2 * (size_t)t->parameters.field.section[l].entries; i++) {
            const uint16_t *at = cn_state_at(cn_parameters_state(&t->parameters, l), i);
            finite &= isfinite(cn_bf16_to_float(at[CN_STATE_M])) && isfinite(cn_bf16_to_float(at[CN_STATE_V]));
        }
    return finite;
}

cn_tile *hard_tile(hard_run *run, const synthetic_scene *synthetic, double step)
{
    cn_tile *tile = NULL;
    char path[96];
    snprintf(path, sizeof path, "%s/hard.safetensors", synthetic->folder);
    memset(run->t.occ.bits, 0xff, CN_OCC_CELLS / 8);
    run->t.box.step = (float)step;
    run->t.sampler.pace.march_step = step;
    hard_must(cn_trainer_save_tile(&run->t, "parent", path));
    hard_must(cn_tile_open(&tile, path));
    return tile;
}

void hard_resume(hard_run *run, const synthetic_scene *synthetic)
{
    char middle[96], end[96], again[96];
    bool resumed;
    snprintf(middle, sizeof middle, "%s/middle.safetensors", synthetic->folder);
    snprintf(end, sizeof end, "%s/end.safetensors", synthetic->folder);
    snprintf(again, sizeof again, "%s/again.safetensors", synthetic->folder);
    hard_must(cn_trainer_save_checkpoint(&run->t, "key", middle));
    for (int i = 0; i < 2; i++)
        hard_must(cn_trainer_step(&run->t));
    hard_must(cn_trainer_save_checkpoint(&run->t, "key", end));
    hard_must(cn_trainer_load_checkpoint(&run->t, "key", middle, &resumed));
    assert_true(resumed);
    for (int i = 0; i < 2; i++)
        hard_must(cn_trainer_step(&run->t));
    hard_must(cn_trainer_save_checkpoint(&run->t, "key", again));
    if (!same_bytes(end, again)) fail_msg("two steps after a resume, other bytes than without");
}

/* The progress callback asks to stop in the middle. It is called every eight steps. */
typedef struct halfway {
    int stop;
} halfway;
static void stop_halfway(void *user, const cn_progress_report *r)
{
    halfway *h = user;
    if (2 * r->done >= r->total) h->stop = 1;
}

static double number(const char *path, const char *key)
{
    json_t *root = NULL;
    double value;
    hard_must(cn_json_load(path, &root));
    value = json_number_value(json_object_get(root, key));
    json_decref(root);
    return value;
}

hard_trained hard_train(const synthetic_scene *synthetic, const cn_train_options *options)
{
    const cn_train_input input = { &synthetic->scene, &synthetic->index, synthetic->pixels, &synthetic->tile };
    const cn_context plain = { 0 };
    halfway h = { 0 };
    const cn_context stopping = { .progress = stop_halfway, .user = &h, .stop = &h.stop };
    hard_trained out = { 0 };
    cn_train_result result;
    char whole[96], parts[96], path[160];
    snprintf(whole, sizeof whole, "%s/whole", synthetic->folder);
    snprintf(parts, sizeof parts, "%s/parts", synthetic->folder);
    hard_must(cn_train_tile(&plain, &input, options, "parent", whole, &result));
    assert_int_equal(cn_train_tile(&stopping, &input, options, "parent", parts, &result), CN_ERR_INTERRUPTED);
    hard_must(cn_train_tile(&plain, &input, options, "parent", parts, &result));
    snprintf(path, sizeof path, "%s/tile.safetensors", parts);
    snprintf(out.tile, sizeof out.tile, "%s/tile.safetensors", whole);
    if (!same_bytes(path, out.tile)) fail_msg("stopped in the middle and resumed, training ends with other bytes");
    snprintf(path, sizeof path, "%s/metrics.json", whole);
    out.psnr = number(path, "train_psnr");
    out.bad_rays = number(path, "bad_rays");
    out.returns = number(path, "returns");
    snprintf(path, sizeof path, "rm -rf %s", parts);
    assert_int_equal(system(path), 0);
    return out;
}
