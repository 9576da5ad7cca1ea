#include "app.h"

#include "conurb/batch.h"
#include "conurb/view.h"

#include <signal.h>
#include <spawn.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/prctl.h>
#include <time.h>
#include <unistd.h>

extern char **environ;

typedef struct options {
    const char *host;
    double port, share;
    bool open, follow;
} options;

static const options defaults = { .port = 7007 };

static const cn_app_option table[] = {
    { "port", "N", "port to listen on; 7007 by default, 0 for one that is free", CN_APP_NUMBER, offsetof(options, port),
      NULL },
    { "host", "ADDRESS",
      "address to listen on; 127.0.0.1 by default, which only this machine reaches (and others through ssh -L). "
      "0.0.0.0 "
      "is every address. The page then asks for a token, which is printed as part of its address",
      CN_APP_TEXT, offsetof(options, host), NULL },
    { "share", "PART",
      "part of the threads that draw, above 0 to 1. By default 1, and 0.5 while a tile is not trained yet, so that "
      "training keeps half",
      CN_APP_NUMBER, offsetof(options, share), NULL },
    { "open", NULL, "open the page in the browser of this machine", CN_APP_FLAG, offsetof(options, open), NULL },
    { "follow", NULL,
      "wait until the city has a plan, and end with the program that started this one: for --view of train and run",
      CN_APP_FLAG, offsetof(options, follow), NULL },
    { 0 }
};

/* Whether every tile is: drawing then need not leave anything to training. */
static bool all_trained(const cn_context *ctx, cn_city *city)
{
    cn_city_state state;
    if (cn_city_state_read(ctx, city, &state) != CN_OK) return true;
    const bool all = state.tiles[CN_WORK_DONE] == state.n_tiles;
    cn_city_state_deinit(&state);
    return all;
}

static void on_ready(void *user, const char *url)
{
    const options *o = user;
    char *argv[] = { (char[]){ "xdg-open" }, (char *)url, NULL };
    pid_t pid;
    printf("%s\n", url);
    fflush(stdout);
    /* Where there is no desktop the address is there to be copied. */
    if (o->open && posix_spawnp(&pid, argv[0], NULL, NULL, argv, environ) != 0)
        fprintf(stderr, "no browser could be opened; open the address by hand\n");
}

/* Until there is a plan, which `conurb run` makes meanwhile. */
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
        /* Another page has the port: the training that this one goes with does not depend on it. */
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
        return cn_fail(CN_ERR_USAGE, "--port goes from 0 to 65535");
    if (!(o.share >= 0 && o.share <= 1)) return cn_fail(CN_ERR_USAGE, "--share is a part, above 0 to 1");
    CN_TRY(cn_city_open(&city, call->operands[0]));
    if (o.follow && wait_for_plan(ctx, call->operands[0]) != CN_OK) {
        cn_city_close(&city);
        return CN_ERR_INTERRUPTED;
    }
    if (o.share == 0) o.share = all_trained(ctx, city) ? 1 : 0.5;
    const cn_status status = serve(ctx, city, &o);
    cn_city_close(&city);
    return status;
}

const cn_app_command cn_app_view = {
    .name = "view",
    .summary = "look at a city in the browser: fly, turn the light, take a path home",
    .forms = "CITY",
    .about =
        "Serves one page, from this machine alone. While the camera moves the picture is small and fast; when it "
        "rests it is refined. Tiles that are trained meanwhile appear as they are done. The city is only read, but "
        "for what is saved from the page: CITY/views/paths, CITY/views/lights, and films in CITY/renders. Ctrl-C "
        "ends it.\n\n"
        "From another machine: ssh -L 7007:localhost:7007 MACHINE, and open http://localhost:7007/ there.",
    .example = "conurb view beach --open",
    .min_operands = 1,
    .max_operands = 1,
    .options = table,
    .size = sizeof(options),
    .defaults = &defaults,
    .run = run_view,
};
