#include "app.h"

#include "conurb/device.h"

#include "conurb/colour.h"
#include "conurb/photo.h"
#include "conurb/video.h"

#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static int stop;

/* When the terminal closes, a program that reads our output (such as tee) ends too. A write to it must not end this
 * process before the work is saved. */
static void on_signal(int number)
{
    if (number == SIGHUP) signal(SIGPIPE, SIG_IGN);
    cn_stop(&stop);
}

/* The first of these signals asks to save and stop. A second Ctrl-C ends the program at once, as usual. SIGHUP stays
 * ignored where it is (nohup). */
static void listen_to_signals(void)
{
    struct sigaction action = { .sa_handler = on_signal }, before;
    sigaction(SIGTERM, &action, NULL);
    if (sigaction(SIGHUP, NULL, &before) == 0 && before.sa_handler != SIG_IGN) sigaction(SIGHUP, &action, NULL);
    action.sa_flags = SA_RESETHAND;
    sigaction(SIGINT, &action, NULL);
}

static cn_status run_command(const cn_app_command *command, const cn_app_common *common, const cn_app_call *call)
{
    cn_context ctx = { .stop = &stop };
    /* In this process only Conurb uses these libraries. */
    cn_photo_own_process();
    cn_colour_own_process();
    cn_video_own_process();
    cn_app_console(&ctx);
    if (!command->passes_device) CN_TRY(cn_app_choose_device(&ctx, common->device, command->computes));
    cn_status status = cn_pool_create(&ctx.pool, common->threads);
    if (status == CN_OK) status = command->run(&ctx, call);
    cn_device_destroy(&ctx.device);
    cn_pool_destroy(&ctx.pool);
    return status;
}

/* words[0] is the command's name. */
static cn_status read_and_run(const cn_app_command *command, int n, char **words)
{
    cn_app_common common;
    cn_app_call call;
    void *values = calloc(1, command->size + 1);
    if (!values) return cn_fail(CN_ERR_NOMEM, "out of memory");
    cn_status status = cn_app_parse(command, n, words, &common, values, &call);
    call.device = common.device;
    if (status == CN_OK && common.help)
        cn_app_print_help(command);
    else if (status == CN_OK)
        status = run_command(command, &common, &call);
    free(values);
    return status;
}

/* conurb help [COMMAND]. With --write DIR it writes the man pages and the completion; the build uses this. */
static cn_status help(int n, char **words)
{
    if (n == 3 && strcmp(words[1], "--write") == 0) return cn_app_write_pages(words[2]);
    const cn_app_command *command = n > 1 ? cn_app_find(words[1]) : NULL;
    if (n > 1 && !command) return cn_fail(CN_ERR_USAGE, "no command '%s'; see conurb --help", words[1]);
    if (command)
        cn_app_print_help(command);
    else
        cn_app_print_commands();
    return CN_OK;
}

static cn_status answer(int argc, char **argv)
{
    if (argc < 2) {
        cn_app_print_commands();
        return CN_ERR_USAGE;
    }
    if (strcmp(argv[1], "--help") == 0 || strcmp(argv[1], "help") == 0) return help(argc - 1, argv + 1);
    if (strcmp(argv[1], "--version") == 0) {
        printf("conurb %s\n", cn_version());
        return CN_OK;
    }
    const cn_app_command *command = cn_app_find(argv[1]);
    if (!command) return cn_fail(CN_ERR_USAGE, "no command '%s'; see conurb --help", argv[1]);
    return read_and_run(command, argc - 1, argv + 1);
}

int main(int argc, char **argv)
{
    listen_to_signals();
    const cn_status status = answer(argc, argv);
    if (status != CN_OK && argc > 1) fprintf(stderr, "conurb: %s\n", cn_error_message());
    return (int)status;
}
