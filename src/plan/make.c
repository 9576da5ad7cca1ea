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
            return cn_fail(CN_ERR_FORMAT, "the poses' tracks name a photo that is not there; run `conurb poses` again");
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
static cn_status release_held_out(const cn_context *ctx, cn_plan *plan, const cn_plan_list *lists, uint32_t n,
                                  bool *held)
{
    for (uint32_t i = 0; i < n; i++) {
        uint32_t released = 0;
        for (uint32_t k = 0; k < lists[i].n && lists[i].n < FEWEST_TO_HOLD_OUT; k++) {
            released += held[lists[i].items[k]];
            held[lists[i].items[k]] = false;
        }
        if (released)
            CN_TRY(cn_plan_warn(ctx, plan, "a tile has only %u photos: %u that would be held out are trained on",
                                lists[i].n, released));
    }
    return CN_OK;
}

static cn_status fill_tile(cn_plan_tile *tile, const cn_plan_circles *circles, uint32_t i, const cn_plan_list *list,
                           const bool *held)
{
    tile->centre[0] = circles->centre[i][0];
    tile->centre[1] = circles->centre[i][1];
    tile->radius_m = circles->radius_m;
    tile->photos = malloc(sizeof *tile->photos * list->n);
    tile->held_out = malloc(sizeof *tile->held_out * list->n);
    if (!tile->photos || !tile->held_out) return cn_fail(CN_ERR_NOMEM, "out of memory for the photos of a tile");
    for (uint32_t k = 0; k < list->n; k++) {
        uint32_t view = list->items[k];
        if (held[view])
            tile->held_out[tile->n_held_out++] = view;
        else
            tile->photos[tile->n_photos++] = view;
    }
    return CN_OK;
}

/* Tiles are worked on a chunk at a time, a tile a thread; warnings and progress come from the calling thread. */
typedef struct finisher {
    cn_plan *plan;
    const cn_plan_input *input;
    const cn_plan_options *options;
    const cn_plan_views *views;
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
    CN_TRY(cn_plan_budget_photos(tile, f->views, f->options));
    CN_TRY(cn_plan_extent(tile, f->views, f->input->scene));
    CN_TRY(cn_plan_part_effects(part, tile, f->views, f->input, f->options));
    CN_TRY(cn_plan_budget_bytes(tile, f->views, f->options, &done->too_big));
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
            tile->id, (double)tile->estimate_bytes / 1e6, tile->n_photos, (double)f->options->max_tile_bytes / 1e6));
    if (tile->n_photos < f->options->min_photos && f->views->n > 2)
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

static cn_status finish_tiles(const cn_context *ctx, cn_plan *plan, const cn_plan_input *input,
                              const cn_plan_options *options, const cn_plan_views *views)
{
    const unsigned threads = cn_pool_threads(ctx ? ctx->pool : NULL);
    const uint32_t chunk = 4 * threads;
    finisher f = { plan, input, options, views, calloc(threads, sizeof *f.parts), calloc(chunk, sizeof *f.done), 0 };
    cn_status status = f.parts && f.done ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory for %u tiles", plan->n_tiles);
    for (unsigned i = 0; i < threads && status == CN_OK; i++)
        status = cn_plan_part_init(&f.parts[i], input->scene);
    if (status == CN_OK) status = finish_chunks(ctx, &f, chunk);
    for (unsigned i = 0; i < threads && f.parts; i++)
        cn_plan_part_deinit(&f.parts[i]);
    free(f.parts);
    free(f.done);
    return status;
}

static cn_status fill_tiles(const cn_context *ctx, cn_plan *plan, const cn_plan_input *input,
                            const cn_plan_options *options, const cn_plan_views *views, const cn_plan_circles *circles,
                            const cn_plan_list *lists, const bool *held)
{
    plan->tiles = calloc(circles->n, sizeof *plan->tiles);
    if (!plan->tiles) return cn_fail(CN_ERR_NOMEM, "out of memory for %u tiles", circles->n);
    plan->n_tiles = circles->n;
    for (uint32_t i = 0; i < circles->n; i++)
        CN_TRY(fill_tile(&plan->tiles[i], circles, i, &lists[i], held));
    CN_TRY(cn_plan_ids(plan, input->frame)); /* the horizontal place decides; heights follow */
    return finish_tiles(ctx, plan, input, options, views);
}

static cn_status make_members(const cn_context *ctx, cn_plan *plan, const cn_plan_input *input,
                              const cn_plan_options *options, const cn_plan_views *views, cn_plan_circles *circles,
                              cn_plan_list *lists, bool *held)
{
    uint32_t n_left, one_left;
    CN_TRY(cn_plan_members(circles, lists, views, input->scene, options, held, &n_left, &one_left));
    /* With a single tile there is nowhere else to belong: no news. */
    if (n_left > 0 && circles->n > 1)
        CN_TRY(cn_plan_warn(ctx, plan,
                            "%u photos (%s among them) stand and look outside every tile with enough photos; "
                            "they went to the nearest",
                            n_left, input->scene->views[one_left].name));
    CN_TRY(release_held_out(ctx, plan, lists, circles->n, held));
    return fill_tiles(ctx, plan, input, options, views, circles, lists, held);
}

static cn_status make(const cn_context *ctx, const cn_plan_input *input, const cn_plan_options *options, cn_plan *plan,
                      cn_plan_views *views, cn_plan_circles *circles, bool **held)
{
    double spacing_m;
    CN_TRY(check_options(options));
    CN_TRY(check_scene(input->scene));
    CN_TRY(cn_plan_views_make(views, input->scene));
    CN_TRY(warn_of_scene(ctx, plan, views));
    CN_TRY(choose_held_out(ctx, plan, views->n, options->hold_out_every, held));
    CN_TRY(cn_plan_layout(circles, views, input->frame, options, &spacing_m));
    cn_log(ctx, CN_LOG_INFO, "plan: %u views, median viewing distance %.2f %s, %u tiles laid out %.2f %s apart",
           views->n, views->distance_m, cn_frame_unit(input->frame), circles->n, spacing_m,
           cn_frame_unit(input->frame));
    uint32_t n = circles->n;
    cn_plan_list *lists = calloc(n, sizeof *lists);
    if (!lists) return cn_fail(CN_ERR_NOMEM, "out of memory for %u tiles", n);
    cn_status status = make_members(ctx, plan, input, options, views, circles, lists, *held);
    for (uint32_t i = 0; i < n; i++)
        free(lists[i].items);
    free(lists);
    return status;
}

cn_status cn_plan_make(const cn_context *ctx, const cn_plan_input *input, const cn_plan_options *options, cn_plan *plan)
{
    cn_plan_views views = { 0 };
    cn_plan_circles circles = { 0 };
    bool *held = NULL;
    *plan = (cn_plan){ .overlap = options->overlap, .layout = options->layout };
    cn_status status = make(ctx, input, options, plan, &views, &circles, &held);
    cn_plan_views_deinit(&views);
    cn_plan_circles_deinit(&circles);
    free(held);
    if (status != CN_OK) cn_plan_deinit(plan);
    return status;
}
