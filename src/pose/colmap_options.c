#include "pose/colmap_options.h"

#include "base/process.h"

#include <ctype.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>

static const struct {
    const char *program, *name, *newer;
} RENAMED[] = {
    { "feature_extractor", "--SiftExtraction.use_gpu", "--FeatureExtraction.use_gpu" },
    { "feature_extractor", "--SiftExtraction.num_threads", "--FeatureExtraction.num_threads" },
    { "feature_extractor", "--SiftExtraction.max_image_size", "--FeatureExtraction.max_image_size" },
    { "matches_importer", "--SiftMatching.use_gpu", "--FeatureMatching.use_gpu" },
    { "matches_importer", "--SiftMatching.num_threads", "--FeatureMatching.num_threads" },
    { "matches_importer", "--SiftMatching.guided_matching", "--FeatureMatching.guided_matching" },
    { "mapper", "--Mapper.ba_global_images_ratio", "--Mapper.ba_global_frames_ratio" },
    { "bundle_adjuster", "--BundleAdjustment.max_num_iterations", "--BundleAdjustmentCeres.max_num_iterations" },
};
enum { N_RENAMED = sizeof RENAMED / sizeof *RENAMED };

/* What the help of a program lists. */
typedef struct help {
    struct help *next;
    char *colmap, *program;
    bool any, name[N_RENAMED], newer[N_RENAMED]; /* any: some option */
} help;

static help *known;
static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;

static bool lists(const char *line, const char *option)
{
    const char *at = strstr(line, option);
    const char after = at ? at[strlen(option)] : '_';
    return !isalnum((unsigned char)after) && after != '_';
}

static void on_line(void *user, char *line)
{
    help *h = user;
    h->any = h->any || strstr(line, "--");
    for (int i = 0; i < N_RENAMED; i++) {
        h->name[i] = h->name[i] || lists(line, RENAMED[i].name);
        h->newer[i] = h->newer[i] || lists(line, RENAMED[i].newer);
    }
}

static void help_free(help *h)
{
    if (!h) return;
    free(h->colmap);
    free(h->program);
    free(h);
}

static cn_status read_help(const cn_context *ctx, const char *colmap, const char *program, help **out)
{
    const char *const argv[] = { colmap, program, "-h", NULL };
    int exit_code;
    help *h = calloc(1, sizeof *h);
    if (h) h->colmap = strdup(colmap);
    if (h) h->program = strdup(program);
    cn_status status = h && h->colmap && h->program ? cn_process_run(ctx, argv, "/dev/null", on_line, h, &exit_code)
                                                    : cn_fail(CN_ERR_NOMEM, "out of memory");
    /* The run that needs the options says why COLMAP cannot be run. */
    if (status == CN_ERR_TOOL) status = CN_OK;
    if (status == CN_OK)
        *out = h;
    else
        help_free(h);
    return status;
}

/* *out stays the list's. */
static cn_status find_help(const cn_context *ctx, const char *colmap, const char *program, const help **out)
{
    cn_status status = CN_OK;
    pthread_mutex_lock(&lock);
    help *h = known;
    while (h && (strcmp(h->colmap, colmap) != 0 || strcmp(h->program, program) != 0))
        h = h->next;
    if (!h) {
        status = read_help(ctx, colmap, program, &h);
        if (status == CN_OK) {
            h->next = known;
            known = h;
        }
    }
    pthread_mutex_unlock(&lock);
    *out = h;
    return status;
}

cn_status cn_colmap_rename(const cn_context *ctx, const char *const *argv, const char **out)
{
    const char *colmap = argv[0], *program = argv[1];
    for (; *argv; argv++, out++) {
        *out = *argv;
        for (int i = 0; i < N_RENAMED; i++) {
            const help *h;
            if (strcmp(*argv, RENAMED[i].name) != 0) continue;
            CN_TRY(find_help(ctx, colmap, program, &h));
            if (h->newer[i] && !h->name[i]) *out = RENAMED[i].newer;
        }
    }
    *out = NULL;
    return CN_OK;
}

cn_status cn_colmap_check_options(const cn_context *ctx, const char *colmap)
{
    for (int i = 0; i < N_RENAMED; i++) {
        const help *h;
        CN_TRY(find_help(ctx, colmap, RENAMED[i].program, &h));
        if (h->any && !h->name[i] && !h->newer[i])
            return cn_fail(CN_ERR_TOOL, "%s %s has neither %s nor %s, so it finds no poses: install COLMAP 3.8 to 4",
                           colmap, RENAMED[i].program, RENAMED[i].name, RENAMED[i].newer);
    }
    return CN_OK;
}
