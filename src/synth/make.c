/* The whole city: build, light, take every photo, write the truth. */
#include "synth/synth.h"

#include "base/clock.h"
#include "base/file.h"
#include "synth/picture.h"
#include "synth/truth.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* ---- one picture ---- */
typedef struct studio {
    const cn_context *ctx;
    const char *out;
    const cn_world *world;
    cn_rig *rig;
    cn_lens_table lenses[CN_RIG_CAMERAS];
    cn_status *status; /* of each photo */
    char (*message)[1024];
    double start_s;
} studio;

static cn_status write_shot(const studio *s, uint32_t i, const cn_film *film)
{
    cn_shot *shot = &s->rig->shots[i];
    const uint32_t w = s->world->options.width, h = s->world->options.height;
    char *photo = cn_truth_path(s->out, "photos", shot->name, ".jpg"),
         *view = cn_truth_path(s->out, "truth/views", shot->name, ".exr");
    char *mask = cn_truth_path(s->out, "truth/masks", shot->name, ".png");
    cn_status status =
        photo && view && mask ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory while writing %s", shot->name);
    if (status == CN_OK) status = cn_shot_develop(s->world, s->rig, shot, i, film, photo);
    if (status == CN_OK) status = cn_film_write_clean(film, w, h, view);
    if (status == CN_OK) status = cn_film_write_mask(film, w, h, mask);
    free(photo);
    free(view);
    free(mask);
    return status;
}

static cn_status take(const studio *s, uint32_t i)
{
    const cn_shot *shot = &s->rig->shots[i];
    const uint32_t w = s->world->options.width, h = s->world->options.height;
    cn_film film;
    cn_crowd crowd;
    CN_TRY(cn_film_create(&film, w, h));
    cn_status status = cn_crowd_init(&crowd, s->world, shot, i);
    if (status == CN_OK) {
        const cn_exposure exposure = { s->world, shot, &crowd, &s->lenses[shot->camera], i, shot->run };
        cn_film_expose(&film, &exposure, 0, h);
        for (size_t p = 0; s->world->options.empty && p < (size_t)w * h; p++)
            film.still[p] = 1;
        status = write_shot(s, i, &film);
        cn_crowd_deinit(&crowd);
    }
    cn_film_destroy(&film);
    return status;
}

static void take_one(void *user, size_t i, unsigned worker)
{
    const studio *s = user;
    if (cn_stopping(s->ctx)) {
        s->status[i] = CN_ERR_INTERRUPTED;
        return;
    }
    s->status[i] = take(s, (uint32_t)i);
    if (s->status[i] != CN_OK) snprintf(s->message[i], sizeof s->message[i], "%s", cn_error_message());
    if (worker != 0) return; /* only the caller's thread may report */
    const double elapsed = cn_now_s() - s->start_s, done = (double)i + 1, total = s->rig->n_shots;
    cn_progress(s->ctx, &(cn_progress_report){ "synth", NULL, done, total, elapsed, elapsed / done * (total - done),
                                               s->rig->shots[i].name });
}

static cn_status take_all(studio *s)
{
    const uint32_t n = s->rig->n_shots;
    s->status = calloc(n, sizeof *s->status);
    s->message = calloc(n, sizeof *s->message);
    cn_status status = s->status && s->message ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory for %u photos", n);
    for (uint32_t c = 0; c < CN_RIG_CAMERAS && status == CN_OK; c++)
        status = cn_lens_table_init(&s->lenses[c], &s->rig->cameras[c]);
    s->start_s = cn_now_s();
    if (status == CN_OK) cn_pool_run(s->ctx ? s->ctx->pool : NULL, n, take_one, s);
    for (uint32_t i = 0; i < n && status == CN_OK; i++)
        if (s->status[i] == CN_ERR_INTERRUPTED)
            status = cn_fail(CN_ERR_INTERRUPTED, "stopped; remove %s and start again", s->out);
        else if (s->status[i] != CN_OK)
            status = cn_fail(s->status[i], "%s", s->message[i]);
    for (uint32_t c = 0; c < CN_RIG_CAMERAS; c++)
        cn_lens_table_deinit(&s->lenses[c]);
    free(s->status);
    free(s->message);
    return status;
}

cn_status cn_synth_make(const cn_context *ctx, const char *out, const cn_synth_options *options)
{
    cn_world world;
    cn_rig rig;
    CN_TRY(cn_synth_options_check(options));
    CN_TRY(cn_truth_begin(out));
    CN_TRY(cn_world_init(&world, options));
    cn_status status = cn_rig_init(&rig, &world);
    if (status != CN_OK) {
        cn_world_deinit(&world);
        return status;
    }
    cn_log(ctx, CN_LOG_INFO, "city of %u houses and %u trees: %u patches; lighting %u places %u times",
           world.town.n_lots, world.town.n_trees, world.mesh.n_patches, world.mesh.n_texels,
           options->plain ? 1 : options->n_runs);
    status = cn_world_bake(ctx, &world, 0, options->plain ? 1 : options->n_runs);
    studio s = { .ctx = ctx, .out = out, .world = &world, .rig = &rig };
    if (status == CN_OK) status = take_all(&s);
    if (status == CN_OK) status = cn_truth_finish(out, &world, &rig);
    cn_rig_deinit(&rig);
    cn_world_deinit(&world);
    return status;
}

/* ---- any view under any light ---- */
static cn_status find_view(const cn_rig *rig, const char *view, uint32_t *index)
{
    char *end;
    const unsigned long number = strtoul(view, &end, 10);
    if (*view && !*end && number < rig->n_shots) {
        *index = (uint32_t)number;
        return CN_OK;
    }
    const size_t n = strlen(view);
    for (*index = 0; *index < rig->n_shots; ++*index) {
        const char *name = rig->shots[*index].name;
        if (strcmp(name, view) == 0 || (strncmp(name, view, n) == 0 && name[n] == '.')) return CN_OK;
    }
    return cn_fail(CN_ERR_USAGE, "--render %s: there is no such photo; give its name or a number below %u", view,
                   rig->n_shots);
}

static cn_status find_light(const cn_world *world, const char *light, uint32_t *run)
{
    char *end;
    const unsigned long number = strtoul(light, &end, 10);
    if (*light && !*end && number < world->n_lights) {
        *run = (uint32_t)number;
        return CN_OK;
    }
    for (*run = 0; *run < world->n_lights; ++*run)
        if (strcmp(world->lights[*run].name, light) == 0) return CN_OK;
    return cn_fail(CN_ERR_USAGE, "--light %s: there is no such run; give its name or a number below %u", light,
                   world->n_lights);
}

typedef struct rendering {
    cn_film *film;
    cn_exposure exposure;
} rendering;

enum { BAND = 8 };

static void expose_band(void *user, size_t i, unsigned worker)
{
    const rendering *r = user;
    const uint32_t height = r->exposure.lens->height;
    const uint32_t from = (uint32_t)i * BAND, to = from + BAND < height ? from + BAND : height;
    (void)worker;
    cn_film_expose(r->film, &r->exposure, from, to);
}

static cn_status render(const cn_context *ctx, cn_world *world, const cn_rig *rig, const char *view, const char *light,
                        const char *file)
{
    uint32_t index, run;
    CN_TRY(find_view(rig, view, &index));
    run = rig->shots[index].run;
    if (light) CN_TRY(find_light(world, light, &run));
    CN_TRY(cn_world_bake(ctx, world, run, 1));
    const cn_camera *camera = &rig->cameras[rig->shots[index].camera];
    cn_lens_table lens;
    cn_film film;
    CN_TRY(cn_lens_table_init(&lens, camera));
    cn_status status = cn_film_create(&film, camera->width, camera->height);
    if (status == CN_OK) {
        rendering r = { &film, { world, &rig->shots[index], NULL, &lens, index, run } };
        cn_pool_run(ctx ? ctx->pool : NULL, (camera->height + BAND - 1) / BAND, expose_band, &r);
        status = cn_film_write_clean(&film, camera->width, camera->height, file);
        cn_film_destroy(&film);
    }
    cn_lens_table_deinit(&lens);
    return status;
}

cn_status cn_synth_render(const cn_context *ctx, const char *out, const char *view, const char *light, const char *file)
{
    cn_synth_options options;
    cn_world world;
    cn_rig rig;
    CN_TRY(cn_truth_load(out, &options));
    CN_TRY(cn_world_init(&world, &options));
    cn_status status = cn_rig_init(&rig, &world);
    if (status == CN_OK) {
        status = render(ctx, &world, &rig, view, light, file);
        cn_rig_deinit(&rig);
    }
    cn_world_deinit(&world);
    return status;
}
