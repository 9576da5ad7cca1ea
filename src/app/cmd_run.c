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

static cn_status run_run(const cn_context *ctx, const cn_app_args *args)
{
    const char *folder, *quality_name = NULL;
    bool dry_run = false;
    double budget_s = 0;
    int quality;
    const cn_app_option options[] = { { "--quality", &quality_name, NULL, NULL },
                                      { "--time-budget", NULL, &budget_s, NULL },
                                      { "--dry-run", NULL, NULL, &dry_run },
                                      { 0 } };
    cn_city *city;
    CN_TRY(cn_app_parse(args, &folder, options));
    CN_TRY(cn_app_parse_quality(quality_name, &quality));
    CN_TRY(cn_city_open(&city, folder));
    const cn_status status =
        dry_run ? print_graph(ctx, city, quality, budget_s) : cn_city_run(ctx, city, quality, budget_s);
    cn_city_close(&city);
    return status;
}

const cn_app_command cn_app_run = {
    "run",
    "all of the above in order, skipping what is done",
    "usage: conurb run CITY [--quality preview|standard|high|reference] [--time-budget 5m] [--dry-run]\n\n"
    "  --time-budget T  a tile's training: 90s, 20m, 2h; without --quality the settings expected to be best in it are "
    "chosen\n"
    "  --dry-run      what is done, what is due and why; makes nothing\n\n"
    "A tile that fails does not stop the others; the exit code and the last line tell of it. Stopped (Ctrl-C, SIGTERM: "
    "exit code 75)\n"
    "or killed, the same command goes on where it was.\n\nexample: conurb init beach --photos photos && conurb run "
    "beach",
    run_run,
};
