#include "stereo/stereo.h"

#include "base/clock.h"
#include "stereo/consistency.h"
#include "stereo/match.h"

#include <stdlib.h>

/* A depth that leads a field need not be exact. At 200 pixels a photo takes a sixth of the time that it takes at 400,
 * and 87 % of the depths at sparse points of sceaux are right to 1 %, in place of 97 %. */
cn_stereo_options cn_stereo_options_default(void)
{
    return (cn_stereo_options){ .width_px = 200, .rounds = 3, .sources = 4, .worst_cost = 0.5f };
}

void cn_stereo_map_deinit(cn_stereo_map *map)
{
    free(map->depth_m);
    *map = (cn_stereo_map){ 0 };
}

#define REPORT_S 1.0

typedef struct run {
    const cn_context *ctx;
    const cn_stereo_input *input;
    const cn_stereo_options *options;
    cn_stereo_views views;
    uint32_t n; /* views that get a map */
    cn_stereo_map *maps;
    cn_status *status;       /* [n] */
    uint32_t first, at_once; /* views of the tasks at hand */
    double start, told;      /* seconds */
} run;

static void report(run *r, double done)
{
    r->told = cn_now_s();
    const double elapsed = r->told - r->start;
    cn_progress(r->ctx, &(cn_progress_report){ .stage = "stereo",
                                               .item = r->input->name,
                                               .done = done,
                                               .total = r->n,
                                               .elapsed_s = elapsed,
                                               .left_s = elapsed * (r->n - done) / done });
}

static bool go_on(void *user, double part)
{
    const run *r = user;
    (void)part;
    return !cn_stopping(r->ctx);
}

/* On the caller's thread. Views that are matched at once are about equally far. */
static bool go_on_and_report(void *user, double part)
{
    run *r = user;
    if (cn_now_s() - r->told > REPORT_S) report(r, r->first + part * r->at_once);
    return go_on(user, part);
}

static void match_view(void *user, size_t i, unsigned worker)
{
    run *r = user;
    const cn_stereo_watch watch = { worker ? go_on : go_on_and_report, r };
    const uint32_t row = r->first + (uint32_t)i;
    const cn_stereo_view *v = &r->views.view[row];
    if (!v->width || !v->n_sources) return;
    cn_stereo_options options = *r->options;
    options.seed += r->input->views[row];
    r->status[row] = cn_stereo_match(&r->views, row, r->input->scene, r->input->prior ? &r->input->prior[row] : NULL,
                                     &options, &watch);
}

static void keep_view(void *user, size_t i, unsigned worker)
{
    (void)worker;
    run *r = user;
    if (r->views.view[i].depth)
        r->status[i] = cn_stereo_keep(&r->views, (uint32_t)i, r->input->prior != NULL, &r->maps[i]);
}

/* A few views at a time, for progress. */
static cn_status match_all(const cn_context *ctx, run *r)
{
    const uint32_t n = r->n, chunk = ctx ? cn_pool_threads(ctx->pool) : 1;
    r->start = r->told = cn_now_s();
    for (r->first = 0; r->first < n; r->first += r->at_once) {
        r->at_once = n - r->first < chunk ? n - r->first : chunk;
        cn_pool_run(ctx ? ctx->pool : NULL, r->at_once, match_view, r);
        if (cn_stopping(ctx)) return cn_fail(CN_ERR_INTERRUPTED, "stopped while depths were found by stereo");
        report(r, r->first + r->at_once);
    }
    cn_pool_run(ctx ? ctx->pool : NULL, n, keep_view, r);
    return CN_OK;
}

cn_status cn_stereo_run(const cn_context *ctx, const cn_stereo_input *input, const cn_stereo_options *options,
                        cn_stereo_map *maps)
{
    run r = {
        .ctx = ctx, .input = input, .options = options, .maps = maps, .status = calloc(input->n + 1u, sizeof *r.status)
    };
    r.n = input->n_wanted ? input->n_wanted : input->n;
    cn_status status = r.status ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory for the depths of photos by stereo");
    if (status == CN_OK) status = cn_stereo_views_init(&r.views, input, options);
    if (status == CN_OK) status = match_all(ctx, &r);
    for (uint32_t i = 0; i < r.n && status == CN_OK; i++)
        status = r.status[i];
    cn_stereo_views_deinit(&r.views);
    free(r.status);
    return status;
}
