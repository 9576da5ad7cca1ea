/* Training and rendering on a graphics processor: the time of each pass by the device's clock, beside the limit of the
 * device that binds it, which is measured in the same run; then whole steps and pictures by the clock.
 * usage: bench_device [--quick] [--samples N] DEVICE [PASSES.csv WORK.csv]
 * --samples: samples of a training step at most; else 2^18, or what standard quality takes in software.
 * Columns of PASSES.csv: as bench_field's (kernel, set, ns_per_sample, gflops, gb_per_s, limit, limit_ns, share); of
 * WORK.csv: figure, m_samples_per_s, at_limit, share. DEVICE: gpu or gpu:N. 77: there is none. */
#include "../unit/train/synthetic.h"
#include "base/clock.h"
#include "base/file.h"
#include "conurb/device.h"
#include "conurb/render.h"
#include "device/passes.h"
#include "device/step_session.h"
#include "device/tracer.h"
#include "device_clock.h"
#include "device_limits.h"
#include "limits.h"
#include "tile/model.h"
#include "train/trainer.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

typedef struct bench {
    cn_context ctx;
    cn_vulkan *device;
    bench_device_limits limits;
    synthetic_scene scene;
    cn_trainer trainer;
    bool quick;
    uint32_t samples; /* of a training step; 0: the default */
    FILE *passes, *work;
    double limit_ns; /* of the passes so far */
} bench;

/* What a pass has to do at least, for one sample. */
typedef struct demand {
    double bytes, flops, reads, updates;
} demand;

static void row(bench *b, const char *name, double ns, const demand *d)
{
    const bench_device_limits *l = &b->limits;
    const struct {
        const char *name;
        double ns;
    } bound[] = { { "memory stream", 1e9 * d->bytes / l->bytes_per_s },
                  { "multiply-adds", 1e9 * d->flops / l->flops_per_s },
                  { "random reads", 1e9 * d->reads / l->reads_per_s },
                  { "random updates", 1e9 * d->updates / l->updates_per_s } };
    int most = 0;
    for (int i = 1; i < 4; i++)
        if (bound[i].ns > bound[most].ns) most = i;
    b->limit_ns += bound[most].ns;
    printf("| %-22s | %9.3f | %8.1f | %7.1f | %-14s | %8.3f | %5.1f %% |\n", name, ns, d->flops / ns, d->bytes / ns,
           bound[most].name, bound[most].ns, 100 * bound[most].ns / ns);
    if (b->passes)
        fprintf(b->passes, "%s,%s,%.4f,%.3f,%.3f,%s,%.4f,%.4f\n", name, "device", ns, d->flops / ns, d->bytes / ns,
                bound[most].name, bound[most].ns, bound[most].ns / ns);
}

static void figure(bench *b, const char *name, double samples_per_s, const char *more)
{
    const double at_limit = b->limit_ns > 0 ? 1e3 / b->limit_ns : 0;
    printf("| %s | %.3f | %.1f | %.1f %% | %s |\n", name, samples_per_s / 1e6, at_limit,
           100 * samples_per_s / 1e6 / at_limit, more);
    if (b->work)
        fprintf(b->work, "%s,%.4f,%.4f,%.4f\n", name, samples_per_s / 1e6, at_limit, samples_per_s / 1e6 / at_limit);
}

/* ---- training ---- */

static cn_status make_trainer(bench *b)
{
    cn_trainer *t = &b->trainer;
    static cn_train_input input;
    cn_train_options o = cn_train_options_preset(CN_QUALITY_STANDARD);
    cn_arena counter;
    o.precision = CN_PRECISION_FLOAT;
    if (!b->device->base.info.software) o.samples_per_step = 1 << 18;
    if (b->samples) o.samples_per_step = b->samples;
    if (b->quick) o = synthetic_options();
    synthetic_scene_init(&b->scene, 9);
    input = (cn_train_input){ &b->scene.scene, &b->scene.index, b->scene.pixels, &b->scene.tile };
    t->ctx = &b->ctx;
    CN_TRY(cn_trainer_plan(t, &input, &o, cn_pool_threads(b->ctx.pool)));
    cn_arena_count(&counter);
    cn_trainer_carve(t, &counter);
    CN_TRY(cn_device_arena_init(&b->ctx, &t->arena, counter.used));
    cn_trainer_carve(t, &t->arena);
    return cn_trainer_begin(t);
}

/* Ends when the device has done all of it. */
static cn_status steps(bench *b, uint32_t n, double *seconds, double *samples, double *live)
{
    const double began = cn_now_s();
    *samples = *live = 0;
    for (uint32_t i = 0; i < n; i++) {
        CN_TRY(cn_trainer_step(&b->trainer));
        *samples += (double)b->trainer.stats.samples;
        *live += (double)b->trainer.stats.live;
    }
    CN_TRY(cn_device_fetch(&b->ctx, &b->trainer.device.step));
    *seconds = cn_now_s() - began;
    return CN_OK;
}

/* Bytes of an array that a step uses: per sample, per live sample, per ray, or all. */
static double bytes_used(const bench *b, const cn_step_session *s, uint32_t array, double samples, double live)
{
    const cn_batch *batch = &b->trainer.batch;
    const double size = (double)s->buffer[array].size, lanes = (double)batch->panel_cap * CN_PANEL,
                 touched = fmin(1, live * 8 * s->settings.levels / (double)b->trainer.parameters.field.entries);
    switch (array) {
    case CN_STEP_TABLE:
    case CN_STEP_STATE:
    case CN_OWN_FIXED: return size * touched;
    case CN_STEP_MARCH_T: return 4 * samples;
    case CN_STEP_PHOTOS: return (double)sizeof(cn_step_photo) * batch->n_rays;
    case CN_STEP_SPARSE: return 12.0 * batch->n_rays / CN_SPARSE_EVERY;
    case CN_STEP_SKY_HINTS: return batch->n_rays;
    case CN_OWN_MAPS: return 20.0 * batch->n_rays; /* a pixel and its direction, wherever they are */
    case CN_OWN_MAPS + 1:
    case CN_OWN_MAPS + 2:
    case CN_OWN_MAPS + 3: return 0;
    case CN_OWN_DRAWN: return size * batch->n_rays / CN_MAX_RAYS;
    case CN_STEP_SEEN:
    case CN_STEP_VISITED:
    case CN_STEP_BITS:
    case CN_OWN_CELL_MOST: return fmin(size, 4 * samples); /* a word of a cell for a sample at most */
    case CN_STEP_POS:
    case CN_STEP_ENC:
    case CN_STEP_LENGTH:
    case CN_STEP_VISIT_CELL:
    case CN_STEP_VISIT_SEEN:
    case CN_OWN_LOGIT:
    case CN_OWN_PANEL_GROUP: return size * samples / lanes;
    case CN_OWN_LIVE:
    case CN_OWN_LIVE_FROM:
    case CN_OWN_LIVE_POS:
    case CN_OWN_ACTS:
    case CN_OWN_D_ACTS:
    case CN_OWN_COLOUR:
    case CN_OWN_D_SAMPLE:
    case CN_OWN_D_PLACE: return size * live / lanes;
    default: return array >= CN_STEP_RAYS && array <= CN_STEP_CONDITIONING ? size * batch->n_rays / CN_MAX_RAYS : size;
    }
}

/* Lines that the corners of a sample's cells fall into: of the table, and of its gradients. */
static demand lines_of(const bench *b)
{
    const cn_grid *grid = &b->trainer.parameters.field.grid;
    demand d = { 0 };
    for (uint32_t l = 0; l < grid->n_levels; l++) {
        d.reads += bench_lines(grid->level[l].hashed);
        d.updates += bench_gradient_lines(grid->level[l].hashed);
    }
    return d;
}

/* The least that the pass has to do in a step: each array that it binds moves once, and a network multiplies. */
static demand demand_of(const bench *b, const cn_step_session *s, cn_step_pass pass, double samples, double live)
{
    const cn_step_settings *at = &s->settings;
    const cn_step_pass_about *about = &cn_step_about[pass];
    const double density = (double)at->density_width * (at->enc_rows + CN_GEO_ROWS),
                 colour = (double)at->colour_width * (at->colour_in + at->colour_width + 4);
    const demand lines = lines_of(b);
    const struct {
        const char *name;
        demand is;
    } known[] = { { "encode", { .reads = samples * lines.reads } },
                  { "logits", { .flops = 2 * samples * at->density_width * (at->enc_rows + 1.0) } },
                  { "forward", { .flops = 2 * live * (density + colour) } },
                  { "backward", { .flops = 2 * live * (density + colour) } },
                  { "weight grad", { .flops = 2 * live * (density + colour) } },
                  { "position", { .reads = live * lines.reads } },
                  { "table grad", { .updates = 2 * live * lines.updates } } };
    demand d = { 0 };
    for (size_t i = 0; i < sizeof known / sizeof *known; i++)
        if (strcmp(known[i].name, about->name) == 0) d = known[i].is;
    const bool table_by_place = d.reads > 0 || d.updates > 0;
    for (uint32_t i = 0; i < about->n; i++) {
        const uint32_t array = about->binding[i];
        if (table_by_place && (array == CN_STEP_TABLE || array == CN_OWN_FIXED)) continue;
        d.bytes += bytes_used(b, s, array, samples, live);
    }
    return d;
}

static cn_status bench_training(bench *b)
{
    const uint32_t warm = b->quick                        ? 8
                          : b->device->base.info.software ? 40
                                                          : 300,
                   n = b->quick                        ? 4
                       : b->device->base.info.software ? 12
                                                       : 100;
    double clock_s, seconds, samples, live, all = 0;
    CN_TRY(make_trainer(b));
    CN_TRY(steps(b, warm, &seconds, &samples, &live));
    const cn_step_session *s = b->device->sessions;
    if (!s || !s->open) return cn_fail(CN_ERR_TOOL, "the device does not train");
    CN_TRY(bench_device_measure(b->device, s->buffer[CN_STEP_TABLE].size, b->quick, &b->limits));
    printf("%s: memory stream %.1f GB/s, multiply-adds %.0f GFLOP/s, random reads of a table of %.1f MB %.2f G/s, "
           "random updates %.2f G/s.\n\n",
           b->device->base.info.name, b->limits.bytes_per_s / 1e9, b->limits.flops_per_s / 1e9,
           (double)s->buffer[CN_STEP_TABLE].size / 1e6, b->limits.reads_per_s / 1e9, b->limits.updates_per_s / 1e9);
    CN_TRY(steps(b, n, &clock_s, &samples, &live));
    const double rate = samples / clock_s;
    bench_clock_begin();
    CN_TRY(steps(b, n, &seconds, &samples, &live));
    CN_TRY(bench_clock_end());
    printf("Training, %.0f samples a step of which %.0f are live; times for one sample.\n\n", samples / n, live / n);
    printf("| pass                   |        ns |  GFLOP/s |    GB/s | limit          | at it ns | reached |\n"
           "|---|---|---|---|---|---|---|\n");
    for (int pass = 0; pass < CN_STEP_PASSES; pass++) {
        const double took = bench_clock_sum(s->pipelines.pipeline[pass]);
        demand d = demand_of(b, s, (cn_step_pass)pass, samples / n, live / n);
        char name[40];
        if (!(took > 0)) continue;
        d = (demand){ d.bytes * n / samples, d.flops * n / samples, d.reads * n / samples, d.updates * n / samples };
        snprintf(name, sizeof name, "train: %s", cn_step_about[pass].name);
        row(b, name, 1e9 * took / samples, &d);
        all += took;
    }
    char more[96];
    snprintf(more, sizeof more, "%.2f ms a step; passes %.0f %% of it", 1e3 * clock_s / n, 100 * all / seconds);
    printf("\n| whole | M samples/s by the clock | M at the limits | reached | |\n|---|---|---|---|---|\n");
    figure(b, "training in full", rate, more);
    return CN_OK;
}

/* ---- rendering ---- */

static cn_status render(bench *b, const cn_tile *tile, cn_picture *picture, double *seconds, double *samples)
{
    cn_render_options o = cn_render_options_default();
    const cn_view *view = &b->scene.scene.views[0];
    cn_camera camera = b->scene.scene.cameras[0];
    const double larger = (double)picture->width / camera.width;
    uint64_t counted = 0;
    o.samples = &counted;
    camera.width = picture->width;
    camera.height = picture->height;
    camera.params[0] *= larger;
    camera.params[1] *= larger;
    camera.params[2] = picture->width / 2.0;
    camera.params[3] = picture->height / 2.0;
    const double began = cn_now_s();
    CN_TRY(cn_render_tile(&b->ctx, tile, &camera, view, &o, picture));
    *seconds = cn_now_s() - began;
    *samples = (double)counted;
    return CN_OK;
}

static demand demand_of_trace(const bench *b, cn_tracer_pass pass)
{
    const cn_field *f = &b->trainer.parameters.field;
    const double enc = 4.0 * f->enc_rows, geo = 4.0 * CN_GEO_ROWS;
    switch (pass) {
    case CN_PASS_MARCH: return (demand){ .bytes = 20 };
    case CN_PASS_ENCODE: return (demand){ .bytes = 16 + enc, .reads = lines_of(b).reads };
    case CN_PASS_DENSITY:
        return (demand){ .bytes = enc + geo, .flops = 2.0 * f->mlp.density_width * (f->enc_rows + CN_GEO_ROWS) };
    case CN_PASS_COMPOSITE: return (demand){ .bytes = 24 };
    case CN_PASS_COLOUR:
        return (demand){ .bytes = geo + 16,
                         .flops = 2.0 * f->mlp.colour_width * (f->colour_in + f->mlp.colour_width + 4) };
    default: return (demand){ .bytes = 16 };
    }
}

/* The pipelines of rendering are made in the order of its passes, after those of training. */
static cn_status bench_rendering(bench *b, uint32_t made_before)
{
    const bool small = b->device->base.info.software;
    const uint32_t width = b->quick ? 96 : small ? 320 : 1920, height = b->quick ? 54 : small ? 180 : 1080;
    double clock_s, seconds, samples;
    cn_picture picture;
    cn_tile *tile;
    char path[160], more[96];
    snprintf(path, sizeof path, "%s/bench.safetensors", b->scene.folder);
    CN_TRY(cn_trainer_save_tile(&b->trainer, NULL, path));
    CN_TRY(cn_tile_open(&tile, path));
    cn_status status = cn_picture_init(&picture, width, height);
    if (status == CN_OK) status = render(b, tile, &picture, &seconds, &samples);
    if (status == CN_OK) status = render(b, tile, &picture, &clock_s, &samples);
    bench_clock_begin();
    const uint32_t made = bench_clock_count();
    if (status == CN_OK) status = render(b, tile, &picture, &seconds, &samples);
    if (status == CN_OK) status = bench_clock_end();
    cn_picture_deinit(&picture);
    cn_tile_close(&tile);
    CN_TRY(status);
    /* A render may make its pipelines anew, or keep them from the first one. */
    const uint32_t first = bench_clock_count() > made ? made : made_before;
    b->limit_ns = 0;
    printf("\nRendering %u x %u, %.0f samples; times for one sample.\n\n", width, height, samples);
    printf("| pass                   |        ns |  GFLOP/s |    GB/s | limit          | at it ns | reached |\n"
           "|---|---|---|---|---|---|---|\n");
    for (uint32_t pass = 0; pass < CN_TRACER_PASSES; pass++) {
        const double took = bench_clock_sum(bench_clock_made(first + pass));
        const demand d = demand_of_trace(b, (cn_tracer_pass)pass);
        char name[40];
        if (!(took > 0) || !samples) continue;
        snprintf(name, sizeof name, "render: %s", cn_tracer_pass_name[pass]);
        row(b, name, 1e9 * took / samples, &d);
    }
    snprintf(more, sizeof more, "%.2f pictures/s; passes %.0f %% of the time", 1 / clock_s,
             100 * bench_clock_sum(VK_NULL_HANDLE) / seconds);
    printf("\n| whole | M samples/s by the clock | M at the limits | reached | |\n|---|---|---|---|---|\n");
    figure(b, "rendering in full", samples / clock_s, more);
    return CN_OK;
}

static cn_status run(bench *b)
{
    CN_TRY(cn_pool_create(&b->ctx.pool, 0));
    CN_TRY(bench_clock_open(b->device));
    if (b->passes) fprintf(b->passes, "kernel,set,ns_per_sample,gflops,gb_per_s,limit,limit_ns,share\n");
    if (b->work) fprintf(b->work, "figure,m_samples_per_s,at_limit,share\n");
    CN_TRY(bench_training(b));
    return bench_rendering(b, bench_clock_count());
}

int main(int argc, char **argv)
{
    static bench b;
    int at = 1;
    b.quick = argc > at && strcmp(argv[at], "--quick") == 0;
    at += b.quick;
    if (argc > at + 1 && strcmp(argv[at], "--samples") == 0) {
        b.samples = (uint32_t)strtoul(argv[at + 1], NULL, 10);
        at += 2;
    }
    if (argc <= at) {
        fputs("usage: bench_device [--quick] [--samples N] DEVICE [PASSES.csv WORK.csv]\n", stderr);
        return 2;
    }
    cn_status status = cn_device_create(argv[at], &b.ctx.device);
    if (status != CN_OK || !cn_device_about(b.ctx.device)->version[0]) {
        fprintf(stderr, "skipped: %s\n",
                status == CN_OK ? "the processor is no graphics processor" : cn_error_message());
        return 77;
    }
    b.device = (cn_vulkan *)b.ctx.device;
    b.passes = argc > at + 1 ? fopen(argv[at + 1], "w") : NULL;
    b.work = argc > at + 2 ? fopen(argv[at + 2], "w") : NULL;
    status = (argc > at + 1 && !b.passes) || (argc > at + 2 && !b.work)
                 ? cn_fail(CN_ERR_IO, "the tables cannot be written")
                 : run(&b);
    if (status != CN_OK) fprintf(stderr, "bench_device: %s\n", cn_error_message());
    if (b.trainer.ctx) cn_trainer_deinit(&b.trainer);
    if (b.scene.pixels) synthetic_scene_deinit(&b.scene);
    bench_clock_close();
    cn_device_destroy(&b.ctx.device);
    cn_pool_destroy(&b.ctx.pool);
    if (b.passes && fclose(b.passes) != 0) status = CN_ERR_IO;
    if (b.work && fclose(b.work) != 0) status = CN_ERR_IO;
    return status == CN_OK ? 0 : 1;
}
