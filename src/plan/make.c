/* Makes a plan: views, layout, members, then each tile's numbers. */
#include "plan/plan.h"

#include <math.h>
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
        return cn_fail(CN_ERR_CONFIG, "plan.hold_out_every 1 holds out every photo and leaves none to train on; use 2 or more, or 0");
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
    if (views->no_parallax)
        CN_TRY(cn_plan_warn(ctx, plan, "all %u photos were taken at one place: nothing can be learnt of depth; "
                            "take photos from several places", views->n));
    return CN_OK;
}

/* Flags every n-th view by name. */
static cn_status choose_held_out(const cn_context *ctx, cn_plan *plan, uint32_t n, uint32_t every, bool **held)
{
    *held = calloc(n, sizeof **held);
    if (!*held) return cn_fail(CN_ERR_NOMEM, "out of memory for %u views", n);
    if (every == 0) return CN_OK;
    if (n < FEWEST_TO_HOLD_OUT)
        return cn_plan_warn(ctx, plan, "no photo is held out, because only %u have a pose: there will be no eval figures", n);
    for (uint32_t i = 0; i < n; i += every) (*held)[i] = true;
    return CN_OK;
}

/* A tile too small to spare any trains on all its photos; so that a photo held out of one tile is held out of all, everywhere. */
static cn_status release_held_out(const cn_context *ctx, cn_plan *plan, const cn_plan_list *lists, uint32_t n, bool *held)
{
    for (uint32_t i = 0; i < n; i++) {
        uint32_t released = 0;
        for (uint32_t k = 0; k < lists[i].n && lists[i].n < FEWEST_TO_HOLD_OUT; k++) {
            released += held[lists[i].items[k]];
            held[lists[i].items[k]] = false;
        }
        if (released)
            CN_TRY(cn_plan_warn(ctx, plan, "a tile has only %u photos: %u that would be held out are trained on", lists[i].n,
                                released));
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
        if (held[view]) tile->held_out[tile->n_held_out++] = view;
        else tile->photos[tile->n_photos++] = view;
    }
    return CN_OK;
}

static cn_status fill_tiles(const cn_context *ctx, cn_plan *plan, const cn_plan_input *input, const cn_plan_options *options,
                            const cn_plan_views *views, const cn_plan_circles *circles, const cn_plan_list *lists,
                            const bool *held)
{
    plan->tiles = calloc(circles->n, sizeof *plan->tiles);
    if (!plan->tiles) return cn_fail(CN_ERR_NOMEM, "out of memory for %u tiles", circles->n);
    plan->n_tiles = circles->n;
    for (uint32_t i = 0; i < circles->n; i++) CN_TRY(fill_tile(&plan->tiles[i], circles, i, &lists[i], held));
    CN_TRY(cn_plan_ids(plan, input->frame)); /* the horizontal place decides; heights follow */
    for (uint32_t i = 0; i < plan->n_tiles; i++) {
        cn_plan_tile *tile = &plan->tiles[i];
        if (cn_stopping(ctx)) return cn_fail(CN_ERR_INTERRUPTED, "stopped while planning; run `conurb plan` again");
        CN_TRY(cn_plan_extent(tile, views, input->scene));
        CN_TRY(cn_plan_effects(tile, input, options));
        if (options->cost) options->cost(options->cost_user, tile, &tile->estimate_s, &tile->estimate_bytes);
        if (tile->n_photos < options->min_photos && views->n > 2)
            CN_TRY(cn_plan_warn(ctx, plan, "tile %s has only %u photos to train on: expect a poor tile", tile->id, tile->n_photos));
        cn_progress(ctx, &(cn_progress_report){.stage = "plan", .item = tile->id, .done = i + 1, .total = plan->n_tiles,
                                               .left_s = -1});
    }
    return CN_OK;
}

static cn_status make_members(const cn_context *ctx, cn_plan *plan, const cn_plan_input *input, const cn_plan_options *options,
                              const cn_plan_views *views, cn_plan_circles *circles, cn_plan_list *lists, bool *held)
{
    uint32_t n_left, one_left;
    CN_TRY(cn_plan_members(circles, lists, views, input->scene, options, held, &n_left, &one_left));
    /* With a single tile there is nowhere else to belong: no news. */
    if (n_left > 0 && circles->n > 1)
        CN_TRY(cn_plan_warn(ctx, plan, "%u photos (%s among them) stand and look outside every tile with enough photos; "
                            "they went to the nearest", n_left, input->scene->views[one_left].name));
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
    cn_log(ctx, CN_LOG_INFO, "plan: %u views, median viewing distance %.2f m, %u tiles laid out %.2f m apart", views->n,
           views->distance_m, circles->n, spacing_m);
    uint32_t n = circles->n;
    cn_plan_list *lists = calloc(n, sizeof *lists);
    if (!lists) return cn_fail(CN_ERR_NOMEM, "out of memory for %u tiles", n);
    cn_status status = make_members(ctx, plan, input, options, views, circles, lists, *held);
    for (uint32_t i = 0; i < n; i++) free(lists[i].items);
    free(lists);
    return status;
}

cn_status cn_plan_make(const cn_context *ctx, const cn_plan_input *input, const cn_plan_options *options, cn_plan *plan)
{
    cn_plan_views views = {0};
    cn_plan_circles circles = {0};
    bool *held = NULL;
    *plan = (cn_plan){.overlap = options->overlap, .layout = options->layout};
    cn_status status = make(ctx, input, options, plan, &views, &circles, &held);
    cn_plan_views_deinit(&views);
    cn_plan_circles_deinit(&circles);
    free(held);
    if (status != CN_OK) cn_plan_deinit(plan);
    return status;
}
