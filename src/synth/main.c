/* conurb-synth: the command line of src/synth. */
#include "synth/synth.h"

#include "conurb/colour.h"
#include "conurb/photo.h"

#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static int stop;
static void on_signal(int signal)
{
    (void)signal;
    cn_stop(&stop);
}

static void print_log(void *user, cn_log_level level, const char *text)
{
    (void)user;
    if (level != CN_LOG_DEBUG) fprintf(stderr, "%s%s\n", level == CN_LOG_WARN ? "warning: " : "", text);
}

static void print_progress(void *user, const cn_progress_report *r)
{
    int *last = user;
    const int tenth = (int)(10 * r->done / r->total);
    if (tenth == *last) return;
    *last = tenth;
    fprintf(stderr, "%s: %.0f of %.0f photos, %.0f s left\n", r->stage, r->done, r->total, r->left_s);
}

static const char HELP[] =
    "conurb-synth: a synthetic city with known truth\n\n"
    "usage: conurb-synth OUT [options]                                  photos in OUT/photos, their truth in "
    "OUT/truth\n"
    "       conurb-synth OUT --render VIEW [--light RUN] --out FILE.exr  one view of a city made before, under any "
    "run's light\n\n"
    "  --seed S             another seed, another city (default 1)\n"
    "  --photos N           default 40\n"
    "  --runs N             capture runs: clear, overcast, low sun, night, and so on (default 4)\n"
    "  --size M             side of the square that is photographed, in metres (default 80)\n"
    "  --width PX --height PX   default 640 x 427\n"
    "  --aerial SHARE       share of photos from the air (default 0.4)\n"
    "  --gps-noise M        standard deviation of a GPS coordinate, in metres (default 1)\n"
    "  --exposure-spread EV photos miss the right exposure by up to so many stops (default 0.7)\n"
    "  --origin LAT,LON,ALT where on Earth, degrees and metres above the sea (default 48.137,11.575,519)\n"
    "  --survey             photos from the air in strips over the whole square, which connect its crossings\n"
    "  --360                photos of all directions, equirectangular, with the XMP that says so (default 1024 x 512)\n"
    "  --plain              the same views without people and cars, in the first run's light, at one exposure\n"
    "  --empty              the same photos without people and cars, exposures and all else alike\n"
    "  --threads N          default: all processors; the bytes are the same\n\n"
    "example: conurb-synth city --seed 7 --photos 100 && conurb init city/work --photos city/photos\n"
    "         conurb-synth city --render run0-clear_street_0000 --light run3-night --out night.exr\n";

typedef struct command {
    cn_synth_options options;
    const char *out, *render, *light, *file;
    double threads;
} command;

static cn_status number(const char *name, const char *text, double *value)
{
    char *end = NULL;
    if (text) *value = strtod(text, &end);
    return text && end != text && !*end ? CN_OK : cn_fail(CN_ERR_USAGE, "%s wants a number; see --help", name);
}

static cn_status whole(const char *name, const char *text, uint32_t *value)
{
    double x = 0;
    CN_TRY(number(name, text, &x));
    if (!(x >= 0 && x <= 4294967295.0) || x != (double)(uint32_t)x)
        return cn_fail(CN_ERR_USAGE, "%s wants a whole number, not %s", name, text);
    *value = (uint32_t)x;
    return CN_OK;
}

static cn_status seed(const char *text, uint64_t *value)
{
    double x = 0;
    CN_TRY(number("--seed", text, &x));
    if (!(x >= 0 && x <= 9007199254740992.0) || x != (double)(uint64_t)x)
        return cn_fail(CN_ERR_USAGE, "--seed wants a whole number below 2^53, not %s", text);
    *value = (uint64_t)x;
    return CN_OK;
}

static cn_status origin(const char *text, cn_synth_options *o)
{
    char rest;
    if (text && sscanf(text, "%lf,%lf,%lf%c", &o->latitude_deg, &o->longitude_deg, &o->altitude_m, &rest) == 3)
        return CN_OK;
    return cn_fail(CN_ERR_USAGE, "--origin wants LATITUDE,LONGITUDE,ALTITUDE; see --help");
}

static cn_status parse_value(command *c, const char *name, const char *value)
{
    cn_synth_options *o = &c->options;
    const struct {
        const char *name;
        double *real;
        uint32_t *whole;
        const char **text;
    } known[] = {
        { "--photos", NULL, &o->n_photos, NULL },       { "--runs", NULL, &o->n_runs, NULL },
        { "--width", NULL, &o->width, NULL },           { "--height", NULL, &o->height, NULL },
        { "--size", &o->size_m, NULL, NULL },           { "--aerial", &o->aerial, NULL, NULL },
        { "--gps-noise", &o->gps_noise_m, NULL, NULL }, { "--exposure-spread", &o->exposure_spread_ev, NULL, NULL },
        { "--threads", &c->threads, NULL, NULL },       { "--render", NULL, NULL, &c->render },
        { "--light", NULL, NULL, &c->light },           { "--out", NULL, NULL, &c->file }
    };
    if (strcmp(name, "--seed") == 0) return seed(value, &o->seed);
    if (strcmp(name, "--origin") == 0) return origin(value, o);
    for (size_t i = 0; i < sizeof known / sizeof *known; i++) {
        if (strcmp(name, known[i].name) != 0) continue;
        if (known[i].real) return number(name, value, known[i].real);
        if (known[i].whole) return whole(name, value, known[i].whole);
        if (!value) return cn_fail(CN_ERR_USAGE, "%s wants a value; see --help", name);
        *known[i].text = value;
        return CN_OK;
    }
    return cn_fail(CN_ERR_USAGE, "no option '%s'; see --help", name);
}

static cn_status parse(int argc, char **argv, command *c)
{
    *c = (command){ .options = cn_synth_options_default() };
    for (int i = 1; i < argc; i++) {
        if (strcmp(argv[i], "--plain") == 0) {
            c->options.plain = true;
        } else if (strcmp(argv[i], "--empty") == 0) {
            c->options.empty = true;
        } else if (strcmp(argv[i], "--survey") == 0) {
            c->options.survey = true;
        } else if (strcmp(argv[i], "--360") == 0) {
            c->options.sphere = true;
        } else if (argv[i][0] == '-') {
            CN_TRY(parse_value(c, argv[i], i + 1 < argc ? argv[i + 1] : NULL));
            i++;
        } else if (c->out) {
            return cn_fail(CN_ERR_USAGE, "'%s' is one word too many; see --help", argv[i]);
        } else {
            c->out = argv[i];
        }
    }
    const cn_synth_options usual = cn_synth_options_default();
    if (c->options.sphere && c->options.width == usual.width && c->options.height == usual.height)
        c->options.width = 1024, c->options.height = 512;
    if (!c->out) return cn_fail(CN_ERR_USAGE, "name the folder to make; see --help");
    if (!c->render != !c->file) return cn_fail(CN_ERR_USAGE, "--render and --out go together; see --help");
    if (c->light && !c->render) return cn_fail(CN_ERR_USAGE, "--light goes with --render; see --help");
    if (!(c->threads >= 0 && c->threads <= 1024))
        return cn_fail(CN_ERR_USAGE, "--threads wants a number from 1 to 1024");
    return cn_synth_options_check(&c->options);
}

static cn_status run(int argc, char **argv)
{
    command c;
    int last = -1;
    cn_context ctx = { .log = print_log, .progress = print_progress, .user = &last, .stop = &stop };
    CN_TRY(parse(argc, argv, &c));
    CN_TRY(cn_pool_create(&ctx.pool, (unsigned)c.threads));
    const cn_status status =
        c.render ? cn_synth_render(&ctx, c.out, c.render, c.light, c.file) : cn_synth_make(&ctx, c.out, &c.options);
    cn_pool_destroy(&ctx.pool);
    return status;
}

int main(int argc, char **argv)
{
    for (int i = 1; i < argc; i++)
        if (strcmp(argv[i], "--help") == 0) {
            fputs(HELP, stdout);
            return 0;
        }
    cn_photo_own_process();
    cn_colour_own_process();
    struct sigaction action = { .sa_handler = on_signal };
    sigaction(SIGINT, &action, NULL);
    sigaction(SIGTERM, &action, NULL);
    const cn_status status = run(argc, argv);
    if (status != CN_OK) fprintf(stderr, "conurb-synth: %s\n", cn_error_message());
    return (int)status;
}
