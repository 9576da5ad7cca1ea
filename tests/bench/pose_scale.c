/* Groups the photos of a made city, merges models of the groups and adjusts the whole; prints time, memory and the
 * distance from the truth as a line of JSON. Fails above a limit.
 * usage: bench_pose_scale PHOTOS [--group N] [--points N] [--gps M] [--by-group] [--limit-s S] [--limit-mb MB]
 * [--limit-m M]
 * --points: sparse points a photo, each seen by about seven photos (default 12). --gps: noise of a GPS coordinate
 * (default 1 m). --by-group: adjusts group by group also where all would fit. The limit in metres is for the distance
 * after the best similarity. */
#include "pose_city.h"

#include "base/clock.h"
#include "base/number.h"
#include "pose/merge.h"
#include "pose/scene.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>

typedef struct settings {
    uint32_t n_photos, group, points;
    double gps_m, limit_s, limit_mb, limit_m;
    bool by_group;
} settings;

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

static void tell(void *user, cn_log_level level, const char *text)
{
    (void)user;
    if (level > CN_LOG_DEBUG) fprintf(stderr, "%.300s\n", text);
}

static int read_settings(int argc, char **argv, settings *s)
{
    const struct {
        const char *name;
        double *value;
    } numbers[] = { { "--gps", &s->gps_m },
                    { "--limit-s", &s->limit_s },
                    { "--limit-mb", &s->limit_mb },
                    { "--limit-m", &s->limit_m } };
    *s = (settings){
        .group = 200, .points = 12, .gps_m = 1, .limit_s = INFINITY, .limit_mb = INFINITY, .limit_m = INFINITY
    };
    if (argc < 2) return -1;
    s->n_photos = (uint32_t)strtoul(argv[1], NULL, 10);
    for (int i = 2; i < argc; i++) {
        bool known = strcmp(argv[i], "--by-group") == 0;
        s->by_group = s->by_group || known;
        if ((strcmp(argv[i], "--group") == 0 || strcmp(argv[i], "--points") == 0) && i + 1 < argc) {
            *(strcmp(argv[i], "--group") == 0 ? &s->group : &s->points) = (uint32_t)strtoul(argv[i + 1], NULL, 10);
            i++;
            continue;
        }
        for (size_t k = 0; k < sizeof numbers / sizeof *numbers && !known && i + 1 < argc; k++)
            if (strcmp(argv[i], numbers[k].name) == 0) {
                *numbers[k].value = cn_parse_double(argv[++i], NULL);
                known = true;
            }
        if (!known) return -1;
    }
    return s->n_photos >= 16 && s->group >= 8 ? 0 : -1;
}

/* What bench_pose_scale measures. */
typedef struct figures {
    double split_s, merge_s, cpu_s, models_mb;
    cn_merge_report report;
    cn_scene scene;
    cn_frame frame;
} figures;

static void run(const settings *s, const cn_context *ctx, const pose_city *city, cn_photo_groups *groups, figures *f)
{
    const double began_s = cn_now_s(), began_cpu = cn_clock_s(CLOCK_PROCESS_CPUTIME_ID);
    pose_city_split(city, s->group, groups);
    f->split_s = cn_now_s() - began_s;
    const double split_cpu = cn_clock_s(CLOCK_PROCESS_CPUTIME_ID) - began_cpu;
    cn_scene *models = calloc(groups->n, sizeof *models);
    if (!models) exit(1);
    for (uint32_t g = 0; g < groups->n; g++)
        pose_city_model(city, groups, g, &models[g]);
    f->models_mb = peak_mb();
    const cn_pose_options options = cn_pose_options_default();
    const cn_merge_task task = { &city->index, groups, models, &options, s->by_group ? 0 : cn_merge_memory() };
    const double merging_s = cn_now_s(), merging_cpu = cn_clock_s(CLOCK_PROCESS_CPUTIME_ID);
    must(cn_groups_merge(ctx, &task, &f->scene, &f->frame, &f->report));
    f->merge_s = cn_now_s() - merging_s;
    f->cpu_s = split_cpu + cn_clock_s(CLOCK_PROCESS_CPUTIME_ID) - merging_cpu;
    for (uint32_t g = 0; g < groups->n; g++)
        cn_scene_deinit(&models[g]);
    free(models);
}

int main(int argc, char **argv)
{
    settings s;
    pose_city city;
    cn_photo_groups groups;
    figures f = { 0 };
    if (read_settings(argc, argv, &s) != 0) {
        fputs("usage: bench_pose_scale PHOTOS [--group N] [--points N] [--gps M] [--by-group] [--limit-s S] "
              "[--limit-mb MB] "
              "[--limit-m M]\n",
              stderr);
        return 2;
    }
    cn_context ctx = { .log = tell };
    must(cn_pool_create(&ctx.pool, 0));
    pose_city_make(&city, &(pose_city_options){ s.n_photos, s.gps_m, true, s.points });
    run(&s, &ctx, &city, &groups, &f);
    const double mb = peak_mb();
    const pose_city_error e = pose_city_compare(&city, &f.scene, &f.frame);
    printf("{\"photos\":%u,\"groups\":%u,\"joined\":%u,\"posed\":%u,\"points\":%u,\"observations\":%llu,\"dropped\":"
           "%llu,\"way\":\"%s\",\"split_s\":%.2f,\"join_s\":%.2f,\"adjust_s\":%.2f,\"total_s\":%.2f,\"cpu_s\":%.2f,"
           "\"models_mb\":%.0f,\"peak_mb\":%.0f,\"error_px\":%.3f,\"rms_m\":%.4f,\"most_m\":%.4f,\"fit_rms_m\":%.4f}\n",
           s.n_photos, groups.n, f.report.n_joined, e.n, f.scene.n_points, (unsigned long long)f.scene.n_observations,
           (unsigned long long)f.report.n_dropped, f.report.way == CN_MERGE_WHOLE ? "whole" : "by group", f.split_s,
           f.report.join_s, f.report.adjust_s, f.split_s + f.merge_s, f.cpu_s, f.models_mb, mb,
           cn_scene_measure_errors(&f.scene), e.rms_m, e.most_m, e.fit_rms_m);
    const bool good = f.split_s + f.merge_s <= s.limit_s && mb <= s.limit_mb && e.fit_rms_m <= s.limit_m &&
                      f.report.n_joined == groups.n;
    if (!good) fputs("a limit was passed\n", stderr);
    cn_scene_deinit(&f.scene);
    cn_merge_report_deinit(&f.report);
    cn_photo_groups_deinit(&groups);
    pose_city_free(&city);
    cn_pool_destroy(&ctx.pool);
    return good ? 0 : 1;
}
