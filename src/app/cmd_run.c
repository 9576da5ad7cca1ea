#include "app.h"

#include "conurb/batch.h"

#include <stdio.h>

static cn_status print_graph(const cn_context *ctx, cn_city *city, int quality, double budget_s)
{
    cn_job_graph graph;
    CN_TRY(cn_city_graph(ctx, city, quality, budget_s, false, &graph));
    for (uint32_t i = 0; i < graph.n; i++) {
        const cn_job_node *n = &graph.nodes[i];
        printf("%-4s  %-6s %-20s%s%s\n", n->done ? "done" : "due", n->stage, n->item, n->done ? "" : "  ", n->reason);
    }
    printf("%u of %u due\n", graph.n_due, graph.n);
    cn_job_graph_deinit(&graph);
    return CN_OK;
}

typedef struct options {
    const char *quality;
    double time_budget_s;
    bool dry_run, view;
} options;

static const cn_app_option table[] = {
    { "quality", "NAME", "preset, instead of the one in city.yaml; its other settings hold", CN_APP_CHOICE,
      offsetof(options, quality), CN_APP_QUALITIES },
    { "time-budget", "T",
      "training time for each tile: 90s, 20m, 2h. When neither --quality nor city.yaml sets a quality, "
      "samples_per_step, march_step or a key of field, the settings are chosen to suit it",
      CN_APP_TIME, offsetof(options, time_budget_s), NULL },
    { "dry-run", NULL, "print what is done, what is due and why; write nothing", CN_APP_FLAG,
      offsetof(options, dry_run), NULL },
    { "view", NULL, "also show the city in the browser, as `conurb view` does, until Ctrl-C", CN_APP_FLAG,
      offsetof(options, view), NULL },
    { 0 }
};

static cn_status run_run(const cn_context *ctx, const cn_app_call *call)
{
    const options *o = call->options;
    const int quality = cn_app_quality(o->quality);
    cn_city *city;
    pid_t page = 0;
    CN_TRY(cn_city_open(&city, call->operands[0]));
    cn_status status = o->view && !o->dry_run ? cn_app_page_start(call, &page) : CN_OK;
    if (status == CN_OK)
        status = o->dry_run ? print_graph(ctx, city, quality, o->time_budget_s)
                            : cn_city_run(ctx, city, quality, o->time_budget_s);
    if (page) cn_app_page_end(ctx, page, status == CN_OK);
    cn_city_close(&city);
    return status;
}

const cn_app_command cn_app_run = {
    .name = "run",
    .summary = "run all stages that are due: poses, plan, train, match, eval, render",
    .forms = "CITY",
    .about = "Work that is done already is skipped. A tile that fails does not stop the others; the last line and the "
             "exit code report it. Ctrl-C or SIGTERM saves the work and ends with exit code 75. Then, or after a kill, "
             "run the same command again: it resumes.",
    .example = "conurb init beach --photos photos && conurb run beach",
    .min_operands = 1,
    .max_operands = 1,
    .options = table,
    .size = sizeof(options),
    .computes = true,
    .run = run_run,
};
