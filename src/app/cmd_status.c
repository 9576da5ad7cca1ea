#include "app.h"

#include "conurb/batch.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

static void print_time(double s)
{
    if (s < 90)
        printf("  %.0f s left", s);
    else if (s < 5400)
        printf("  %.0f min left", s / 60);
    else
        printf("  %.1f h left", s / 3600);
}

static void print_row(const cn_work_row *r)
{
    printf("%-6s %-20s %-8s", r->stage, r->item, cn_work_name(r->work));
    const bool group = strcmp(r->stage, "group") == 0 && r->work == CN_WORK_DONE;
    const char *unit = strcmp(r->stage, "train") == 0 ? "step " : "", *thing = group ? " photos" : "";
    if (r->total > 0)
        printf("  %s%.0f of %.0f%s", unit, r->done, r->total, thing);
    else if (r->done > 0)
        printf("  %s%.0f", unit, r->done);
    if (isfinite(r->psnr)) printf("  PSNR %.2f dB", r->psnr);
    if (isfinite(r->samples_per_s)) printf("  %.2f M samples/s", r->samples_per_s / 1e6);
    if (r->work == CN_WORK_RUNNING && r->left_s >= 0) print_time(r->left_s);
    if (r->memory_bytes > 0) printf("  %.0f MB", r->memory_bytes / 1e6);
    if (r->where[0]) printf("  (%s)", r->where);
    if (r->note[0]) printf("  %s", r->note);
    printf("\n");
}

static void print_state(const cn_city_state *state)
{
    for (uint32_t i = 0; i < state->n; i++)
        print_row(&state->rows[i]);
    if (!state->n_tiles)
        printf("no tiles yet: there is no plan");
    else
        printf("%u tiles:", state->n_tiles);
    const char *comma = "";
    for (int w = CN_WORK_DONE; w >= 0; w--)
        if (state->tiles[w]) {
            printf("%s %u %s", comma, state->tiles[w], cn_work_name((cn_work)w));
            comma = ",";
        }
    if (state->left_s >= 0) print_time(state->left_s);
    printf("\n");
    if (state->queue[0]) printf("the queue is not known: %s\n", state->queue);
    fflush(stdout);
}

static cn_status show(const cn_context *ctx, cn_city *city, bool json)
{
    cn_city_state state;
    char *text = NULL;
    CN_TRY(cn_city_state_read(ctx, city, &state));
    const cn_status status = json ? cn_city_state_json(&state, &text) : CN_OK;
    if (text)
        printf("%s\n", text);
    else if (status == CN_OK)
        print_state(&state);
    fflush(stdout);
    free(text);
    cn_city_state_deinit(&state);
    return status;
}

/* Redraws on a terminal; prints one after another when piped. */
static cn_status watch(const cn_context *ctx, cn_city *city, bool json)
{
    while (!cn_stopping(ctx)) {
        if (isatty(STDOUT_FILENO)) printf("\033[H\033[2J");
        CN_TRY(show(ctx, city, json));
        sleep(2);
    }
    return CN_OK;
}

static uint32_t count_due(const cn_job_graph *graph, const char *stage, uint32_t *n)
{
    uint32_t due = 0;
    *n = 0;
    for (uint32_t i = 0; i < graph->n; i++)
        if (strcmp(graph->nodes[i].stage, stage) == 0) ++*n, due += !graph->nodes[i].done && !graph->nodes[i].failed;
    return due;
}

/* Whether a stage, or all that comes before it, is done: for scripts that wait. */
static cn_status check_done(const cn_context *ctx, cn_city *city, const char *stage, int quality)
{
    cn_job_graph graph;
    uint32_t n, due;
    CN_TRY(cn_city_graph(ctx, city, quality, 0, true, &graph));
    due = count_due(&graph, stage, &n);
    /* Few photos have no groups, a single tile has no match, and without held-out photos there are no scores. */
    if (!n) due = count_due(&graph, strcmp(stage, "group") == 0 ? "poses" : "train", &n);
    cn_job_graph_deinit(&graph);
    return due ? cn_fail(CN_ERR_DATA, "%s: %u of %u not done", stage, due, n) : CN_OK;
}

typedef struct options {
    const char *done, *quality;
    bool watch, json;
} options;

static const cn_app_option table[] = {
    { "watch", NULL, "print again every two seconds, until Ctrl-C", CN_APP_FLAG, offsetof(options, watch), NULL },
    { "json", NULL, "print JSON", CN_APP_FLAG, offsetof(options, json), NULL },
    { "done", "STAGE", "print nothing. The exit code is 0 when that stage is done and valid, and 4 when it is not",
      CN_APP_CHOICE, offsetof(options, done), "group poses plan train match eval render" },
    { "quality", "NAME", "with --done: the quality that the tiles are trained with, instead of the one in city.yaml",
      CN_APP_CHOICE, offsetof(options, quality), CN_APP_QUALITIES },
    { 0 }
};

static cn_status run_status(const cn_context *ctx, const cn_app_call *call)
{
    const options *o = call->options;
    cn_city *city;
    if (o->quality && !o->done) return cn_fail(CN_ERR_USAGE, "--quality belongs to --done STAGE");
    CN_TRY(cn_city_open(&city, call->operands[0]));
    const cn_status status = o->done    ? check_done(ctx, city, o->done, cn_app_quality(o->quality))
                             : o->watch ? watch(ctx, city, o->json)
                                        : show(ctx, city, o->json);
    cn_city_close(&city);
    return status;
}

const cn_app_command cn_app_status = {
    .name = "status",
    .summary = "show the progress of each tile, here and on a cluster",
    .forms = "CITY",
    .about = "Prints one line for each group of photos and each tile: state, step, PSNR, samples per second, time "
             "left, memory, and the machine "
             "it runs on. A tile is lost when its process has not reported for a while: run or submit again to resume "
             "it. After `conurb submit` the state of the Slurm queue is shown too.",
    .example = "conurb status beach --watch",
    .min_operands = 1,
    .max_operands = 1,
    .options = table,
    .size = sizeof(options),
    .run = run_status,
};
