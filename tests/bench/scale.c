/* Plans a synthetic city of PHOTOS photos over 1 km2 and prints its time and memory as a line of JSON. Fails above a
 * limit. usage: bench_scale PHOTOS [--limit-s S] [--limit-mb MB] [--tile-mb MB] [--out DIR] */
#include "scale_city.h"

#include "base/clock.h"
#include "conurb/train.h"
#include "pose/scene.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

typedef struct limits {
    double seconds, mb, tile_mb;
    const char *out;
} limits;

static double peak_mb(void)
{
    struct rusage usage;
    getrusage(RUSAGE_SELF, &usage);
    return (double)usage.ru_maxrss * 1024 / 1e6;
}

static void must(cn_status status)
{
    if (status == CN_OK) return;
    fprintf(stderr, "%s\n", cn_error_message());
    exit(1);
}

static void cost(void *user, const cn_plan_tile *tile, double *seconds, uint64_t *bytes)
{
    cn_train_cost(user, tile, seconds, bytes);
}

static double file_mb(const char *dir, const char *name)
{
    char path[512];
    struct stat st;
    snprintf(path, sizeof path, "%s/%s", dir, name);
    return stat(path, &st) == 0 ? (double)st.st_size / 1e6 : 0;
}

static cn_plan_options options_of(cn_train_options *train, const limits *limit)
{
    cn_plan_options o = cn_plan_options_default();
    o.rules = cn_effect_rules(&o.n_rules);
    o.cost = cost;
    o.cost_user = train;
    o.max_tile_bytes = (uint64_t)(limit->tile_mb * 1e6);
    return o;
}

typedef struct extremes {
    uint32_t photos;
    uint64_t bytes, memberships;
} extremes;
static extremes extremes_of(const cn_plan *plan)
{
    extremes e = { 0 };
    for (uint32_t i = 0; i < plan->n_tiles; i++) {
        const cn_plan_tile *t = &plan->tiles[i];
        if (t->n_photos > e.photos) e.photos = t->n_photos;
        if (t->estimate_bytes > e.bytes) e.bytes = t->estimate_bytes;
        e.memberships += t->n_photos + t->n_held_out;
    }
    return e;
}

static void quiet(void *user, cn_log_level level, const char *text)
{
    (void)user;
    if (level >= CN_LOG_WARN) fprintf(stderr, "%.200s\n", text);
}

static bool measure(uint32_t n, const limits *limit)
{
    scale_city city;
    scale_city_make(&city, n);
    const double made_mb = peak_mb(), start = cn_now_s(), start_cpu = cn_clock_s(CLOCK_PROCESS_CPUTIME_ID);
    uint32_t lost;
    must(cn_scene_tie(&city.scene, &city.photos, &lost));
    const double tied = cn_now_s();
    cn_train_options train = cn_train_options_preset(CN_QUALITY_STANDARD);
    const cn_plan_options options = options_of(&train, limit);
    const cn_plan_input input = { &city.scene, &city.photos, &city.frame, NULL };
    cn_context ctx = { .log = quiet };
    cn_plan plan, again;
    must(cn_pool_create(&ctx.pool, 0));
    must(cn_plan_make(&ctx, &input, &options, &plan));
    const double planned = cn_now_s();
    must(cn_plan_save(&plan, &input, limit->out));
    const double saved = cn_now_s(), cpu = cn_clock_s(CLOCK_PROCESS_CPUTIME_ID) - start_cpu, mb = peak_mb();
    must(cn_plan_load(&again, &city.scene, limit->out));
    const double loaded = cn_now_s();
    const extremes e = extremes_of(&plan), f = extremes_of(&again);
    printf("{\"photos\":%u,\"points\":%u,\"tiles\":%u,\"memberships\":%llu,\"most_photos\":%u,\"tile_mb\":%.1f,\"tie_"
           "s\":%.3f,\"plan_s\":%.3f,"
           "\"save_s\":%.3f,\"load_s\":%.3f,\"total_s\":%.3f,\"cpu_s\":%.3f,\"input_mb\":%.1f,\"peak_mb\":%.1f,\"json_"
           "mb\":%.2f,\"svg_mb\":%.2f}\n",
           n, city.scene.n_points, plan.n_tiles, (unsigned long long)e.memberships, e.photos, (double)e.bytes / 1e6,
           tied - start, planned - tied, saved - planned, loaded - saved, saved - start, cpu, made_mb, mb,
           file_mb(limit->out, "plan.json"), file_mb(limit->out, "plan.svg"));
    const bool same = plan.n_tiles == again.n_tiles && e.memberships == f.memberships && e.photos == f.photos && !lost;
    if (!same) fputs("what was read is not what was written\n", stderr);
    if (saved - start > limit->seconds)
        fprintf(stderr, "planning took %.1f s, more than %.0f\n", saved - start, limit->seconds);
    if (mb > limit->mb) fprintf(stderr, "planning took %.0f MB, more than %.0f\n", mb, limit->mb);
    if ((double)e.bytes > limit->tile_mb * 1e6)
        fprintf(stderr, "a tile takes %.0f MB, more than %.0f\n", (double)e.bytes / 1e6, limit->tile_mb);
    const bool good =
        same && saved - start <= limit->seconds && mb <= limit->mb && (double)e.bytes <= limit->tile_mb * 1e6;
    cn_plan_deinit(&plan);
    cn_plan_deinit(&again);
    cn_pool_destroy(&ctx.pool);
    scale_city_free(&city);
    return good;
}

int main(int argc, char **argv)
{
    char made[] = "/tmp/conurb-scale-XXXXXX";
    limits limit = { .seconds = 120, .mb = 6000, .tile_mb = 1500 };
    for (int i = 2; i + 1 < argc; i += 2) {
        if (strcmp(argv[i], "--limit-s") == 0) limit.seconds = atof(argv[i + 1]);
        if (strcmp(argv[i], "--limit-mb") == 0) limit.mb = atof(argv[i + 1]);
        if (strcmp(argv[i], "--tile-mb") == 0) limit.tile_mb = atof(argv[i + 1]);
        if (strcmp(argv[i], "--out") == 0) limit.out = argv[i + 1];
    }
    if (argc < 2 || atof(argv[1]) < 1 || atof(argv[1]) > 1e8) {
        fputs("usage: bench_scale PHOTOS [--limit-s S] [--limit-mb MB] [--tile-mb MB] [--out DIR]\n", stderr);
        return 2;
    }
    const bool temporary = !limit.out;
    if (temporary && !(limit.out = mkdtemp(made))) return 1;
    const bool good = measure((uint32_t)atof(argv[1]), &limit);
    if (temporary) {
        char command[600];
        snprintf(command, sizeof command, "rm -rf '%s'", limit.out);
        if (system(command) != 0) return 1;
    }
    return good ? 0 : 1;
}
