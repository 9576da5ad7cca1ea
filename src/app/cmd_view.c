#include "app.h"

#include "conurb/view.h"

#include <signal.h>
#include <spawn.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/prctl.h>
#include <time.h>
#include <unistd.h>

extern char **environ;

/* Of two processes with as many threads each, the one that is nicer by this gets about a third of the processor. */
enum { NICER = 3 };

typedef struct options {
    const char *host;
    double port, share;
    bool open, follow;
} options;

static const options defaults = { .port = 7007 };

static const cn_app_option table[] = {
    { "port", "N", "port to listen on; by default 7007. 0: any free port", CN_APP_NUMBER, offsetof(options, port),
      NULL },
    { "host", "ADDRESS",
      "address to listen on; by default 127.0.0.1, which only this machine can reach (others through ssh -L). 0.0.0.0: "
      "every address. The page then needs a token, which is part of the printed URL",
      CN_APP_TEXT, offsetof(options, host), NULL },
    { "share", "PART",
      "fraction of the threads that render, above 0 to 1. By default all of them render, but at a lower priority: "
      "where "
      "training runs too, at least half of the processor is left to it",
      CN_APP_NUMBER, offsetof(options, share), NULL },
    { "open", NULL, "open the page in the browser of this machine", CN_APP_FLAG, offsetof(options, open), NULL },
    { "follow", NULL,
      "wait until the city has a plan, and end with the parent process; used by --view of train and run", CN_APP_FLAG,
      offsetof(options, follow), NULL },
    { 0 }
};

static void on_ready(void *user, const char *url)
{
    const options *o = user;
    char *argv[] = { (char[]){ "xdg-open" }, (char *)url, NULL };
    pid_t pid;
    printf("%s\n", url);
    fflush(stdout);
    /* Without a desktop a person can still copy the printed URL. */
    if (o->open && posix_spawnp(&pid, argv[0], NULL, NULL, argv, environ) != 0)
        fprintf(stderr, "no browser could be started; open the address above yourself\n");
}

/* Waits for the plan, which `conurb run` makes in the parent process. */
static cn_status wait_for_plan(const cn_context *ctx, const char *city)
{
    const struct timespec pause = { .tv_nsec = 300000000 };
    char path[4096];
    prctl(PR_SET_PDEATHSIG, SIGTERM);
    snprintf(path, sizeof path, "%s/plan/plan.json", city);
    while (access(path, R_OK) != 0) {
        if (cn_stopping(ctx) || getppid() == 1) return cn_fail(CN_ERR_INTERRUPTED, "stopped before there was a plan");
        nanosleep(&pause, NULL);
    }
    return CN_OK;
}

static cn_status serve(const cn_context *ctx, cn_city *city, const options *o)
{
    const unsigned all = cn_pool_threads(ctx->pool), n = (unsigned)(all * o->share + 0.5);
    cn_context part = *ctx;
    cn_viewer_options viewer = { .host = o->host, .port = (uint16_t)o->port, .ready = on_ready, .user = (void *)o };
    part.pool = NULL;
    CN_TRY(cn_pool_create(&part.pool, n ? n : 1));
    cn_status status = cn_viewer_serve(&part, city, &viewer);
    if (status == CN_ERR_IO && o->follow && viewer.port) {
        /* Another page has the port. That is no error for the training that started this one. */
        viewer.port = 0;
        status = cn_viewer_serve(&part, city, &viewer);
    }
    cn_pool_destroy(&part.pool);
    return status;
}

static cn_status run_view(const cn_context *ctx, const cn_app_call *call)
{
    options o = *(const options *)call->options;
    cn_city *city;
    if (!(o.port >= 0 && o.port <= 65535) || o.port != (double)(uint16_t)o.port)
        return cn_fail(CN_ERR_USAGE, "--port: give 0 to 65535");
    if (!(o.share >= 0 && o.share <= 1)) return cn_fail(CN_ERR_USAGE, "--share: give a fraction above 0, up to 1");
    CN_TRY(cn_city_open(&city, call->operands[0]));
    if (o.follow && wait_for_plan(ctx, call->operands[0]) != CN_OK) {
        cn_city_close(&city);
        return CN_ERR_INTERRUPTED;
    }
    if (o.share == 0) {
        (void)nice(NICER); /* threads that begin from here on inherit it; every process may be nicer */
        o.share = 1;
    }
    const cn_status status = serve(ctx, city, &o);
    cn_city_close(&city);
    return status;
}

const cn_app_command cn_app_view = {
    .name = "view",
    .summary = "show a city in the browser: fly, change the light, save a path",
    .forms = "CITY",
    .about =
        "Serves a web page; by default only this machine can open it. While the camera moves, the picture is small and "
        "fast; then it is refined. Tiles that finish training appear by themselves. The city is only read, except for "
        "what the page saves: CITY/views with paths, lights and what is fitted to a dropped photo, and films in "
        "CITY/renders. Ctrl-C ends it.\n\nFrom "
        "another machine: run ssh -L 7007:localhost:7007 MACHINE there, and open http://localhost:7007/.",
    .example = "conurb view beach --open",
    .min_operands = 1,
    .max_operands = 1,
    .options = table,
    .size = sizeof(options),
    .defaults = &defaults,
    .computes = true,
    .run = run_view,
};
