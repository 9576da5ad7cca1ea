/* Makes a plan: views, layout, members, then each tile's numbers. */
#include "plan/plan.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define FEWEST_TO_HOLD_OUT 4u

static cn_status check_options(const cn_plan_options *o)
{
    if (!(o->overlap >= 0 && o->overlap <= 0.95))
        return cn_fail(CN_ERR_CONFIG, "plan.overlap %g must lie between 0 and 0.95", o->overlap);
    if (!(o->spacing_m >= 0) || isinf(o->spacing_m))
        return cn_fail(CN_ERR_CONFIG, "plan.spacing_m %g must be 0 (automatic) or more", o->spacing_m);
    if (!(o->min_points_seen >= 0 && o->min_points_seen <= 1))
        return cn_fail(CN_ERR_CONFIG, "plan.min_points_seen %g must lie between 0 and 1", o->min_points_seen);
    if (o->hold_out_every == 1)
        return cn_fail(CN_ERR_CONFIG,
                       "plan.hold_out_every 1 holds out every photo and leaves none to train on; use 2 or more, or 0");
    return CN_OK;
}

static cn_status check_scene(const cn_scene *scene)
{
    if (scene->n_views == 0) return cn_fail(CN_ERR_DATA, "no photo has a pose; run `conurb poses` first");
    for (uint64_t i = 0; i < scene->n_observations; i++)
        if (scene->observations[i].view >= scene->n_views)
            return cn_fail(CN_ERR_FORMAT,
                           "the tracks of the poses name a photo that does not exist; run `conurb poses` again");
    for (uint32_t i = 0; i < scene->n_views; i++) {
        double c[3];
        cn_view_centre(&scene->views[i], c);
        if (!isfinite(c[0] + c[1] + c[2]))
            return cn_fail(CN_ERR_DATA, "the pose of %s is not finite; run `conurb poses` again", scene->views[i].name);
    }
    return CN_OK;
}

static cn_status warn_of_scene(const cn_context *ctx, cn_plan *plan, const cn_plan_views *views)
{
    if (views->n == 1)
        return cn_plan_warn(ctx, plan, "only one photo has a pose: nothing can be learnt of depth; take more photos");
    if (views->n == 2)
        CN_TRY(cn_plan_warn(ctx, plan, "only two photos have a pose: expect a poor tile; take more photos"));
    if (!views->has_points)
        CN_TRY(cn_plan_warn(
            ctx, plan,
            "the poses come without sparse points: how far photos see is guessed, and effects are not measured; set "
            "plan.spacing_m and effects in city.yaml, or let COLMAP find the poses"));
    if (views->no_parallax)
        CN_TRY(cn_plan_warn(ctx, plan,
                            "all %u photos were taken at one place: nothing can be learnt of depth; "
                            "take photos from several places",
                            views->n));
    return CN_OK;
}

/* Flags every n-th view by name. */
static cn_status choose_held_out(const cn_context *ctx, cn_plan *plan, uint32_t n, uint32_t every, bool **held)
{
    *held = calloc(n, sizeof **held);
    if (!*held) return cn_fail(CN_ERR_NOMEM, "out of memory for %u views", n);
    if (every == 0) return CN_OK;
    if (n < FEWEST_TO_HOLD_OUT)
        return cn_plan_warn(ctx, plan,
                            "no photo is held out, because only %u have a pose: there will be no eval figures", n);
    for (uint32_t i = 0; i < n; i += every)
        (*held)[i] = true;
    return CN_OK;
}

/* A tile with too few photos holds none out and trains on all of them. But a photo that another tile holds out is
 * held out everywhere. */
static cn_status release_held_out(const cn_context *ctx, cn_plan *plan, cn_plan_draft *d)
{
    for (uint32_t i = 0; i < d->circles.n; i++) {
        const cn_plan_list *list = &d->lists[i];
        uint32_t released = 0;
        for (uint32_t k = 0; k < list->n && list->n < FEWEST_TO_HOLD_OUT; k++) {
            released += d->held[list->items[k]];
            d->held[list->items[k]] = false;
        }
        if (released)
            CN_TRY(cn_plan_warn(ctx, plan, "a tile has only %u photos: %u that would be held out are trained on",
                                list->n, released));
    }
    return CN_OK;
}

static cn_status fill_tile(cn_plan_tile *tile, const cn_plan_draft *d, uint32_t i)
{
    const cn_plan_list *list = &d->lists[i];
    tile->centre[0] = d->circles.centre[i][0];
    tile->centre[1] = d->circles.centre[i][1];
    tile->radius_m = d->radius_m[i] > 0 ? d->radius_m[i] : d->circles.radius_m;
    tile->photos = malloc(sizeof *tile->photos * list->n);
    tile->held_out = malloc(sizeof *tile->held_out * list->n);
    if (!tile->photos || !tile->held_out) return cn_fail(CN_ERR_NOMEM, "out of memory for the photos of a tile");
    for (uint32_t k = 0; k < list->n; k++) {
        uint32_t view = list->items[k];
        if (d->held[view])
            tile->held_out[tile->n_held_out++] = view;
        else
            tile->photos[tile->n_photos++] = view;
    }
    return CN_OK;
}

/* Tiles are processed in chunks, one tile per thread. Warnings and progress come from the calling thread. */
typedef struct finisher {
    cn_plan *plan;
    const cn_plan_draft *draft;
    cn_plan_part *parts; /* one a thread */
    struct finished {
        cn_status status;
        bool thinned, too_big;
        char message[512];
    } * done;       /* of the chunk */
    uint32_t first; /* of the chunk */
} finisher;

static cn_status finish_tile(const finisher *f, cn_plan_tile *tile, cn_plan_part *part, struct finished *done)
{
    const uint32_t n = tile->n_photos;
    const cn_plan_draft *d = f->draft;
    CN_TRY(cn_plan_budget_photos(tile, &d->views, d->options));
    CN_TRY(cn_plan_extent(tile, &d->views, d->input->scene));
    CN_TRY(cn_plan_part_effects(part, tile, &d->views, d->input, d->options));
    CN_TRY(cn_plan_budget_bytes(tile, &d->views, d->options, &done->too_big));
    done->thinned = tile->n_photos < n;
    return CN_OK;
}

static void finish_one(void *user, size_t i, unsigned worker)
{
    finisher *f = user;
    struct finished *done = &f->done[i];
    *done = (struct finished){ 0 };
    done->status = finish_tile(f, &f->plan->tiles[f->first + i], &f->parts[worker], done);
    if (done->status != CN_OK) snprintf(done->message, sizeof done->message, "%s", cn_error_message());
}

static cn_status report_tile(const cn_context *ctx, const finisher *f, const cn_plan_tile *tile,
                             const struct finished *done)
{
    if (done->status != CN_OK) return cn_fail(done->status, "%s", done->message);
    if (done->too_big)
        CN_TRY(cn_plan_warn(
            ctx, f->plan,
            "tile %s takes %.0f MB even with %u photos, more than the %.0f MB that a tile may take: its settings "
            "need more memory",
            tile->id, (double)tile->estimate_bytes / 1e6, tile->n_photos,
            (double)f->draft->options->max_tile_bytes / 1e6));
    if (tile->n_photos < f->draft->options->min_photos && f->draft->views.n > 2)
        CN_TRY(cn_plan_warn(ctx, f->plan, "tile %s has only %u photos to train on: expect a poor tile", tile->id,
                            tile->n_photos));
    return CN_OK;
}

static cn_status finish_chunks(const cn_context *ctx, finisher *f, uint32_t chunk)
{
    cn_plan *plan = f->plan;
    uint32_t n_thinned = 0;
    for (f->first = 0; f->first < plan->n_tiles; f->first += chunk) {
        if (cn_stopping(ctx)) return cn_fail(CN_ERR_INTERRUPTED, "stopped while planning; run `conurb plan` again");
        const uint32_t n = plan->n_tiles - f->first < chunk ? plan->n_tiles - f->first : chunk;
        cn_pool_run(ctx ? ctx->pool : NULL, n, finish_one, f);
        for (uint32_t i = 0; i < n; i++) {
            CN_TRY(report_tile(ctx, f, &plan->tiles[f->first + i], &f->done[i]));
            n_thinned += f->done[i].thinned;
        }
        cn_progress(ctx, &(cn_progress_report){ .stage = "plan",
                                                .item = plan->tiles[f->first + n - 1].id,
                                                .done = f->first + n,
                                                .total = plan->n_tiles,
                                                .left_s = -1 });
    }
    if (n_thinned == 0) return CN_OK;
    return cn_plan_warn(
        ctx, plan,
        "%u of %u tiles have more photos than their budget allows: they train on some of them, spread evenly over "
        "where photos stand and which way they look",
        n_thinned, plan->n_tiles);
}

static cn_status finish_tiles(const cn_context *ctx, cn_plan *plan, const cn_plan_draft *d)
{
    const unsigned threads = cn_pool_threads(ctx ? ctx->pool : NULL);
    const uint32_t chunk = 4 * threads;
    finisher f = { plan, d, calloc(threads, sizeof *f.parts), calloc(chunk, sizeof *f.done), 0 };
    cn_status status = f.parts && f.done ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory for %u tiles", plan->n_tiles);
    for (unsigned i = 0; i < threads && status == CN_OK; i++)
        status = cn_plan_part_init(&f.parts[i], d->input->scene);
    if (status == CN_OK) status = finish_chunks(ctx, &f, chunk);
    for (unsigned i = 0; i < threads && f.parts; i++)
        cn_plan_part_deinit(&f.parts[i]);
    free(f.parts);
    free(f.done);
    return status;
}

static cn_status fill_tiles(const cn_context *ctx, cn_plan *plan, const cn_plan_draft *d)
{
    const uint32_t n = d->circles.n;
    plan->tiles = calloc(n, sizeof *plan->tiles);
    if (!plan->tiles) return cn_fail(CN_ERR_NOMEM, "out of memory for %u tiles", n);
    plan->n_tiles = n;
    for (uint32_t i = 0; i < n; i++)
        CN_TRY(fill_tile(&plan->tiles[i], d, i));
    CN_TRY(cn_plan_ids(plan, d->input->frame)); /* the horizontal place decides; heights follow */
    return finish_tiles(ctx, plan, d);
}

static cn_status make_tiles(const cn_context *ctx, cn_plan *plan, cn_plan_draft *d)
{
    CN_TRY(cn_plan_members(d));
    if (d->n_joined)
        cn_log(ctx, CN_LOG_INFO, "plan: %u of these tiles have the same photos as another, which stands for them",
               d->n_joined);
    /* With a single tile this is not worth a warning. */
    if (d->n_left > 0 && d->circles.n > 1)
        CN_TRY(cn_plan_warn(ctx, plan,
                            "%u photos (%s among them) stand and look outside every tile with enough photos; "
                            "they went to the nearest",
                            d->n_left, d->input->scene->views[d->one_left].name));
    CN_TRY(release_held_out(ctx, plan, d));
    return fill_tiles(ctx, plan, d);
}

static cn_status make(const cn_context *ctx, cn_plan *plan, cn_plan_draft *d)
{
    const cn_frame *frame = d->input->frame;
    double spacing_m;
    CN_TRY(check_options(d->options));
    CN_TRY(check_scene(d->input->scene));
    CN_TRY(cn_plan_views_make(&d->views, d->input->scene, d->options->spacing_m));
    CN_TRY(warn_of_scene(ctx, plan, &d->views));
    CN_TRY(choose_held_out(ctx, plan, d->views.n, d->options->hold_out_every, &d->held));
    CN_TRY(cn_plan_layout(&d->circles, &d->views, frame, d->options, &spacing_m));
    cn_log(ctx, CN_LOG_INFO, "plan: %u views, median viewing distance %.2f %s, %u tiles laid out %.2f %s apart",
           d->views.n, d->views.distance_m, cn_frame_unit(frame), d->circles.n, spacing_m, cn_frame_unit(frame));
    const uint32_t n = d->circles.n; /* before some are dropped */
    d->lists = calloc(n, sizeof *d->lists);
    d->radius_m = calloc(n, sizeof *d->radius_m);
    cn_status status =
        d->lists && d->radius_m ? make_tiles(ctx, plan, d) : cn_fail(CN_ERR_NOMEM, "out of memory for %u tiles", n);
    for (uint32_t i = 0; i < n && d->lists; i++)
        free(d->lists[i].items);
    free(d->lists);
    free(d->radius_m);
    return status;
}

cn_status cn_plan_make(const cn_context *ctx, const cn_plan_input *input, const cn_plan_options *options, cn_plan *plan)
{
    cn_plan_draft draft = { .input = input, .options = options };
    *plan = (cn_plan){ .overlap = options->overlap, .layout = options->layout };
    cn_status status = make(ctx, plan, &draft);
    cn_plan_views_deinit(&draft.views);
    cn_plan_circles_deinit(&draft.circles);
    free(draft.held);
    if (status != CN_OK) cn_plan_deinit(plan);
    return status;
}
