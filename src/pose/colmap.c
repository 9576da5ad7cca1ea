#include "pose/colmap.h"

#include "base/file.h"

#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#define MANY_PHOTOS 10 /* photos that must share a lens before all of OPENCV's parameters are estimated */
#define EVERY_PAIR 200 /* photos at most of which an attempt matches every pair, whatever their GPS */
#define LONG_LIST 1000 /* number of photos from which matching every pair gives a warning */
/* COLMAP saves its matches at the end of each block. Its default block is 50 x 50 photos or 1225 pairs, so a small
 * collection is one block, and a killed run loses all matches. Use smaller blocks. */
enum { LEAST_BLOCK = 6, MOST_BLOCK = 50, BLOCKS = 8 };     /* photos; blocks a side */
enum { LEAST_PAIRS = 100, MOST_PAIRS = 1225, PARTS = 50 }; /* pairs; parts of the list */

static cn_status remove_database(const cn_colmap_job *j)
{
    static const char *const SUFFIXES[] = { "", "-wal", "-shm", "-journal" };
    for (int i = 0; i < 4; i++) {
        char *path = cn_format("%s%s", j->database, SUFFIXES[i]);
        if (!path) return cn_fail(CN_ERR_NOMEM, "out of memory");
        cn_status status = cn_file_remove(path);
        free(path);
        CN_TRY(status);
    }
    return CN_OK;
}

/* camera: that of the group, where an earlier run has made it; 0: none yet. */
static cn_status extract(cn_colmap_job *j, const uint32_t *photos, const cn_lens_group *group, uint32_t camera,
                         const char *list)
{
    const bool full = group->shared && group->n >= MANY_PHOTOS && !j->way->simple_camera;
    const char *argv[CN_JOB_WORDS];
    char size[16], features[16], existing[16];
    int n = 0, exit_code;
    CN_TRY(cn_colmap_write_list(j->index, j->linked, list, photos + group->first, group->n));
    snprintf(size, sizeof size, "%u", j->options->max_image_px);
    snprintf(features, sizeof features, "%u", j->options->max_features);
    const char *const base[] = { j->options->colmap,
                                 "feature_extractor",
                                 "--database_path",
                                 j->database,
                                 "--image_path",
                                 j->images,
                                 "--image_list_path",
                                 list,
                                 "--ImageReader.single_camera",
                                 group->shared ? "1" : "0",
                                 "--ImageReader.camera_model",
                                 full ? "OPENCV" : "SIMPLE_RADIAL",
                                 "--SiftExtraction.use_gpu",
                                 "0",
                                 "--SiftExtraction.num_threads",
                                 j->threads,
                                 "--SiftExtraction.max_image_size",
                                 size,
                                 "--SiftExtraction.max_num_features",
                                 features,
                                 NULL };
    snprintf(existing, sizeof existing, "%u", camera);
    const char *const reuse[] = { "--ImageReader.existing_camera_id", existing, NULL };
    cn_job_words(argv, &n, base);
    cn_job_words(argv, &n, j->way->features);
    if (camera) cn_job_words(argv, &n, reuse);
    CN_TRY(cn_job_run(j, argv, &exit_code));
    return exit_code ? cn_job_failed(j, exit_code) : CN_OK;
}

/* Links named by number, for photos whose names do not work in COLMAP's lists. */
static cn_status make_links(const cn_colmap_job *j)
{
    CN_TRY(cn_folder_make(j->images));
    for (uint32_t i = 0; i < j->index->n_photos; i++) {
        char *name = cn_colmap_name(j->index, true, i);
        char *link = name ? cn_path_join(j->images, name) : NULL;
        char *target = cn_path_join(j->index->folder, j->index->photos[i].name);
        cn_status status = link && target ? cn_file_remove(link) : cn_fail(CN_ERR_NOMEM, "out of memory");
        if (status == CN_OK && symlink(target, link) != 0)
            status = cn_fail(CN_ERR_IO, "%s: cannot make a link: %s", link, strerror(errno));
        free(name);
        free(link);
        free(target);
        CN_TRY(status);
    }
    return CN_OK;
}

/* COLMAP skips photos that are in the database. Keep those of a killed run with the same inputs. Remove a database of
 * other inputs, or a damaged one. cameras: one a group, or 0. Caller frees. */
static cn_status begin_features(cn_colmap_job *j, const cn_lens_groups *groups, uint32_t **cameras)
{
    const size_t size = (groups->n_groups + (size_t)1) * sizeof **cameras;
    *cameras = calloc(1, size);
    if (!*cameras) return cn_fail(CN_ERR_NOMEM, "out of memory");
    CN_TRY(cn_job_remove_marker(j, "matches", "begun"));
    CN_TRY(cn_job_remove_marker(j, "matches", "done"));
    if (cn_job_is_marked(j, "begun") && cn_file_exists(j->database)) {
        if (cn_colmap_find_cameras(j->index, j->linked, groups, j->database, *cameras) == CN_OK) {
            cn_log(j->ctx, CN_LOG_INFO, "the search for features resumes with the photos of an earlier run");
            return CN_OK;
        }
        cn_log(j->ctx, CN_LOG_WARN, "%s; the features are searched for again", cn_error_message());
        memset(*cameras, 0, size);
    }
    CN_TRY(cn_job_remove_marker(j, j->stage, "begun"));
    CN_TRY(remove_database(j));
    return cn_job_mark(j, "begun");
}

static cn_status extract_groups(cn_colmap_job *j, const cn_lens_groups *groups, const uint32_t *cameras)
{
    char *list = cn_path_join(j->dir, "photos.txt");
    cn_status status = list ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory");
    for (uint32_t i = 0; i < groups->n_groups && status == CN_OK; i++)
        status = extract(j, groups->order, &groups->groups[i], cameras[i], list);
    free(list);
    return status;
}

cn_status cn_colmap_features(cn_colmap_job *j)
{
    cn_job_begin(j, "features", j->index->n_photos);
    const uint32_t settings[] = { j->options->max_image_px, j->options->max_features, j->options->single_camera };
    cn_job_mix(j, settings, sizeof settings);
    cn_job_mix_words(j, j->way->features);
    for (uint32_t i = 0; i < j->index->n_photos; i++) {
        cn_job_mix(j, j->index->photos[i].name, strlen(j->index->photos[i].name));
        cn_job_mix(j, &j->index->photos[i].hash, sizeof j->index->photos[i].hash);
    }
    if (cn_job_is_done(j) && cn_file_exists(j->database)) return CN_OK;
    cn_lens_groups groups = { 0 };
    uint32_t *cameras = NULL;
    cn_status status = cn_job_unmark(j);
    if (status == CN_OK && j->linked) status = make_links(j);
    if (status == CN_OK) status = cn_colmap_group(j->index, j->options->single_camera, &groups);
    if (status == CN_OK) status = begin_features(j, &groups, &cameras);
    if (status == CN_OK) status = extract_groups(j, &groups, cameras);
    cn_lens_groups_deinit(&groups);
    free(cameras);
    return status == CN_OK ? cn_job_mark_done(j) : status;
}

/* COLMAP skips pairs that are in the database. Keep those of a killed run with the same inputs; remove those of other
 * inputs, such as another matcher. */
static cn_status begin_matches(cn_colmap_job *j)
{
    char *begun = cn_job_marker(j, j->stage, "begun"), *done = cn_job_marker(j, j->stage, "done");
    const bool room = begun && done, fresh = room && !cn_file_exists(begun) && !cn_file_exists(done);
    free(begun);
    free(done);
    if (!room) return cn_fail(CN_ERR_NOMEM, "out of memory");
    CN_TRY(cn_job_unmark(j));
    if (cn_job_is_marked(j, "begun")) {
        cn_log(j->ctx, CN_LOG_INFO, "matching resumes with the matches of an earlier run");
        return CN_OK;
    }
    if (!fresh) {
        int exit_code;
        const char *const argv[] = { j->options->colmap, "database_cleaner", "--type", "matches",
                                     "--database_path",  j->database,        NULL };
        CN_TRY(cn_job_remove_marker(j, j->stage, "begun"));
        CN_TRY(cn_job_run(j, argv, &exit_code));
        if (exit_code) return cn_job_failed(j, exit_code);
    }
    return cn_job_mark(j, "begun");
}

static cn_status match(cn_colmap_job *j, const char *command, const char *const *extra)
{
    const char *const base[] = { j->options->colmap,
                                 command,
                                 "--database_path",
                                 j->database,
                                 "--SiftMatching.use_gpu",
                                 "0",
                                 "--SiftMatching.num_threads",
                                 j->threads,
                                 NULL };
    const char *argv[CN_JOB_WORDS];
    int n = 0, exit_code;
    cn_job_words(argv, &n, base);
    cn_job_words(argv, &n, extra);
    cn_job_words(argv, &n, j->way->matches);
    CN_TRY(cn_job_run(j, argv, &exit_code));
    return exit_code ? cn_job_failed(j, exit_code) : CN_OK;
}

static cn_matcher choose_matcher(const cn_colmap_job *j)
{
    if (j->way->every_pair && j->index->n_photos <= EVERY_PAIR) return CN_MATCH_EXHAUSTIVE;
    if (j->options->matcher != CN_MATCH_AUTO) return j->options->matcher;
    return 2 * (uint64_t)j->index->n_gps > j->index->n_photos ? CN_MATCH_GPS : CN_MATCH_EXHAUSTIVE;
}

/* One part of the list at a time, because COLMAP saves its matches at the end of a list. */
static cn_status match_parts(cn_colmap_job *j, const char *path, const char *text, size_t size)
{
    const char *const extra[] = { "--match_list_path", path, "--match_type", "pairs", NULL };
    const uint32_t most = (uint32_t)fmin(fmax(j->total / PARTS, LEAST_PAIRS), MOST_PAIRS);
    for (const char *at = text, *end = text + size; at < end;) {
        const char *next = at;
        uint32_t n = 0;
        for (const char *line; n < most && next < end; n++) {
            line = memchr(next, '\n', (size_t)(end - next));
            next = line ? line + 1 : end;
        }
        j->part = n;
        CN_TRY(cn_file_write(path, at, (size_t)(next - at)));
        CN_TRY(match(j, "matches_importer", extra));
        j->base += n;
        cn_job_tell(j, j->base);
        at = next;
    }
    return CN_OK;
}

static cn_status match_pairs(cn_colmap_job *j, const char *text, size_t size, uint64_t n_pairs)
{
    cn_job_mix(j, text, size);
    if (cn_job_is_done(j)) return CN_OK;
    char *path = cn_path_join(j->dir, "pairs.txt");
    if (!path) return cn_fail(CN_ERR_NOMEM, "out of memory");
    cn_log(j->ctx, CN_LOG_INFO, "matching %llu pairs of neighbours by GPS", (unsigned long long)n_pairs);
    cn_job_begin(j, "matches", (double)n_pairs);
    cn_status status = begin_matches(j);
    if (status == CN_OK) status = match_parts(j, path, text, size);
    free(path);
    return status == CN_OK ? cn_job_mark_done(j) : status;
}

/* Matches every pair; for a film, each photo with the next ones. */
static cn_status match_all(cn_colmap_job *j, cn_matcher matcher)
{
    const uint32_t n = j->index->n_photos;
    cn_job_mix(j, &matcher, sizeof matcher);
    if (cn_job_is_done(j)) return CN_OK;
    cn_job_begin(j, "matches", matcher == CN_MATCH_SEQUENTIAL ? n : 0.5 * n * (n - 1.0));
    CN_TRY(begin_matches(j));
    if (matcher == CN_MATCH_SEQUENTIAL) {
        CN_TRY(match(j, "sequential_matcher", NULL));
        return cn_job_mark_done(j);
    }
    if (n > LONG_LIST)
        cn_log(j->ctx, CN_LOG_WARN,
               "matching every pair of %u photos takes long: photos with GPS, or poses.matcher: sequential for a film, "
               "take much less",
               n);
    char block[16];
    const char *const extra[] = { "--ExhaustiveMatching.block_size", block, NULL };
    snprintf(block, sizeof block, "%.0f", fmin(fmax(n / BLOCKS, LEAST_BLOCK), MOST_BLOCK));
    CN_TRY(match(j, "exhaustive_matcher", extra));
    return cn_job_mark_done(j);
}

cn_status cn_colmap_matches(cn_colmap_job *j)
{
    char *text = NULL;
    size_t size = 0;
    uint64_t n_pairs = 0;
    cn_matcher matcher = choose_matcher(j);
    cn_job_begin(j, "matches", 0.0);
    cn_job_mix_words(j, j->way->matches);
    if (matcher == CN_MATCH_GPS) {
        CN_TRY(cn_colmap_pairs(j->index, j->linked, j->options->neighbours, &text, &size, &n_pairs));
        cn_status status = n_pairs ? match_pairs(j, text, size, n_pairs) : CN_OK;
        free(text);
        if (n_pairs || status != CN_OK) return status;
        cn_log(j->ctx, CN_LOG_WARN, "GPS gives the same place for most photos: every pair is matched");
        matcher = CN_MATCH_EXHAUSTIVE;
    }
    return match_all(j, matcher);
}
