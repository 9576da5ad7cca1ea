#include "app.h"

#include "conurb/colour.h"
#include "conurb/photo.h"
#include "conurb/video.h"

#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static int stop;

/* With the terminal goes what reads our output there, tee for one: a write to it must not end us before all is saved.
 */
static void on_signal(int number)
{
    if (number == SIGHUP) signal(SIGPIPE, SIG_IGN);
    cn_stop(&stop);
}

/* The first of these signals asks to save and stop. A second Ctrl-C has the usual effect: it ends the program at once.
 * Where SIGHUP is ignored (nohup) it stays so. */
static void listen_to_signals(void)
{
    struct sigaction action = { .sa_handler = on_signal }, before;
    sigaction(SIGTERM, &action, NULL);
    if (sigaction(SIGHUP, NULL, &before) == 0 && before.sa_handler != SIG_IGN) sigaction(SIGHUP, &action, NULL);
    action.sa_flags = SA_RESETHAND;
    sigaction(SIGINT, &action, NULL);
}

static void print_help(void)
{
    printf("conurb %s: geo-referenced photos in, a city of radiance fields out\n\nusage: conurb COMMAND CITY "
           "[options]\n\n",
           cn_version());
    for (int i = 0; i < cn_app_n_commands; i++)
        printf("  %-10s %s\n", cn_app_commands[i]->name, cn_app_commands[i]->summary);
    printf("\nEvery command takes --help and --threads N (default: all processors).\n"
           "Example: conurb init beach --photos photos && conurb run beach\n");
}

/* Takes --threads N out of the words. */
static cn_status take_threads(cn_app_args *args, unsigned *threads)
{
    int kept = 0;
    for (int i = 0; i < args->n; i++) {
        if (strcmp(args->words[i], "--threads") != 0) {
            args->words[kept++] = args->words[i];
            continue;
        }
        char *end = NULL;
        const long n = i + 1 < args->n ? strtol(args->words[i + 1], &end, 10) : 0;
        if (!end || *end || n < 1 || n > 1024) return cn_fail(CN_ERR_USAGE, "--threads wants a number from 1 to 1024");
        *threads = (unsigned)n;
        i++;
    }
    args->n = kept;
    return CN_OK;
}

static cn_status run_command(const cn_app_command *command, cn_app_args *args)
{
    unsigned threads = 0;
    CN_TRY(take_threads(args, &threads));
    cn_context ctx = { .stop = &stop };
    cn_app_console(&ctx);
    CN_TRY(cn_pool_create(&ctx.pool, threads));
    const cn_status status = command->run(&ctx, args);
    cn_pool_destroy(&ctx.pool);
    return status;
}

static const cn_app_command *find(const char *name)
{
    for (int i = 0; i < cn_app_n_commands; i++)
        if (strcmp(cn_app_commands[i]->name, name) == 0) return cn_app_commands[i];
    return NULL;
}

int main(int argc, char **argv)
{
    if (argc < 2 || strcmp(argv[1], "--help") == 0 || strcmp(argv[1], "help") == 0) {
        print_help();
        return argc < 2 ? CN_ERR_USAGE : 0;
    }
    if (strcmp(argv[1], "--version") == 0) {
        printf("conurb %s\n", cn_version());
        return 0;
    }
    const cn_app_command *command = find(argv[1]);
    if (!command) {
        fprintf(stderr, "conurb: no command '%s'; see conurb --help\n", argv[1]);
        return CN_ERR_USAGE;
    }
    cn_app_args args = { argc - 2, argv + 2 };
    for (int i = 0; i < args.n; i++)
        if (strcmp(args.words[i], "--help") == 0) {
            printf("%s\n\n%s\n", command->summary, command->usage);
            return 0;
        }
    /* This process is Conurb's alone. */
    cn_photo_own_process();
    cn_colour_own_process();
    cn_video_own_process();
    listen_to_signals();
    const cn_status status = run_command(command, &args);
    if (status != CN_OK) fprintf(stderr, "conurb: %s\n", cn_error_message());
    return (int)status;
}
