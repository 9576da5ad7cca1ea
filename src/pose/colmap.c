#include "pose/colmap.h"

#include "base/clock.h"
#include "base/file.h"
#include "base/hash.h"
#include "base/json.h"
#include "base/process.h"
#include "pose/lens.h"
#include "pose/scene.h"

#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#define MARKER_VERSION 1
#define MOST_WORDS 48
#define MANY_PHOTOS 10 /* photos that must share a lens before all of OPENCV's parameters are estimated */
#define LONG_LIST 1000 /* number of photos from which matching every pair gives a warning */
#define SILENCE_S 2    /* at most, between two reports of progress */
/* COLMAP saves its matches at the end of each block. Its default block is 50 x 50 photos or 1225 pairs, so a small
 * collection is one block, and a killed run loses all matches. Use smaller blocks. */
enum { LEAST_BLOCK = 6, MOST_BLOCK = 50, BLOCKS = 8 };     /* photos; blocks a side */
enum { LEAST_PAIRS = 100, MOST_PAIRS = 1225, PARTS = 50 }; /* pairs; parts of the list */

typedef struct job {
    const cn_context *ctx;
    const cn_photo_index *index;
    const cn_pose_options *options;
    const char *dir;
    char *log, *database, *images,
        *note; /* images: folder that COLMAP reads; note: file that names the running COLMAP */
    char threads[16];
    bool linked;
    uint64_t chain; /* hash of all inputs up to this stage */
    const char *stage;
    double started_s, base, part, done,
        total; /* progress; part: the fraction of the total that this run of COLMAP does */
    double told_s, advanced_s, step_s,
        left_s;                 /* time of the last report; of the last progress; recent seconds per unit of `done` */
    char photo[256], last[512]; /* photo being read; last line, or last error */
    bool error_seen;
} job;

static void report(job *j, double now)
{
    /* When a step takes longer than expected, the time left is unknown. */
    const double left = j->left_s - (now - j->advanced_s);
    const cn_progress_report report = { "poses",  j->stage,           j->done,
                                        j->total, now - j->started_s, left >= 0.0 ? left : -1.0,
                                        NULL };
    j->told_s = now;
    cn_progress(j->ctx, &report);
}

/* Predict from the last steps only: a resumed run skips the first ones quickly. */
static void tell(job *j, double done)
{
    const double now = cn_now_s(), more = done - j->done;
    if (more > 0.0) {
        const double step_s = (now - j->advanced_s) / more;
        j->step_s = j->step_s > 0.0 ? 0.7 * j->step_s + 0.3 * step_s : step_s;
        j->advanced_s = now;
    }
    j->done = done;
    j->left_s = j->total >= done && j->step_s > 0.0 ? j->step_s * (j->total - done) : -1.0;
    report(j, now);
}

static void on_wait(void *user)
{
    job *j = user;
    const double now = cn_now_s();
    if (now - j->told_s >= SILENCE_S) report(j, now);
}

static void on_feature_line(job *j, const char *line)
{
    unsigned done, total;
    if (sscanf(line, "Processed file [%u/%u]", &done, &total) == 2) {
        tell(j, j->base + done);
        if (done == total) j->base += total;
    } else if (sscanf(line, " Name: %255[^\n]", j->photo) != 1 && strstr(line, "ERROR:")) {
        cn_log(j->ctx, CN_LOG_WARN, "COLMAP cannot read photo %s: %s", j->photo, strstr(line, "ERROR:") + 7);
    }
}

static void on_line(void *user, char *line)
{
    job *j = user;
    unsigned a, b, c, d;
    bool is_error = strstr(line, "ERROR") != NULL || strstr(line, "what():") != NULL;
    if (is_error || !j->error_seen) snprintf(j->last, sizeof j->last, "%s", line + strspn(line, " "));
    j->error_seen = j->error_seen || is_error;
    if (strcmp(j->stage, "features") == 0) {
        on_feature_line(j, line);
    } else if (sscanf(line, "Matching block [%u/%u, %u/%u]", &a, &b, &c, &d) == 4) {
        if (a && b && d) tell(j, j->base + j->part * ((double)(a - 1) * d + c) / ((double)b * d));
    } else if (sscanf(line, "Matching block [%u/%u]", &a, &b) == 2) {
        if (b) tell(j, j->base + j->part * a / b);
    } else if (sscanf(line, "Registering image #%u (%u)", &a, &b) == 2) {
        tell(j, b);
    }
}

static cn_status run(job *j, const char *const *argv, int *exit_code)
{
    j->last[0] = '\0';
    j->error_seen = false;
    const cn_process process = {
        .argv = argv, .log_path = j->log, .note_path = j->note, .on_line = on_line, .on_wait = on_wait, .user = j
    };
    cn_status status = cn_process_watch(j->ctx, &process, exit_code);
    if (status == CN_ERR_TOOL)
        return cn_fail(CN_ERR_TOOL,
                       "cannot run %s, which finds the poses: install the package colmap (apt-get install "
                       "colmap), or set poses.import to a COLMAP model or transforms.json",
                       argv[0]);
    return status;
}

static cn_status failed(const job *j, int exit_code)
{
    if (exit_code > 128)
        return cn_fail(CN_ERR_TOOL, "COLMAP was killed by signal %d at %s%s; see %s", exit_code - 128, j->stage,
                       exit_code == 137 ? " (out of memory? lower poses.max_image_px or the threads)" : "", j->log);
    return cn_fail(CN_ERR_TOOL, "COLMAP failed at %s: %s (exit code %d); see %s", j->stage, j->last, exit_code, j->log);
}

/* Marker files: the hash of the inputs for which a stage was begun or finished. */
static char *marker_path(const job *j, const char *stage, const char *what)
{
    return cn_format("%s/%s.%s.json", j->dir, stage, what);
}

static bool is_marked(const job *j, const char *what)
{
    char *path = marker_path(j, j->stage, what), mine[17];
    const char *theirs;
    json_t *root = NULL;
    int64_t version = 0;
    cn_hash_hex(j->chain, mine);
    bool marked = path && cn_file_exists(path) && cn_json_load(path, &root) == CN_OK &&
                  cn_json_integer(root, path, "version", &version) == CN_OK && version == MARKER_VERSION &&
                  cn_json_string(root, path, "work", &theirs) == CN_OK && strcmp(mine, theirs) == 0;
    json_decref(root);
    free(path);
    return marked;
}

static bool is_done(const job *j)
{
    return is_marked(j, "done");
}

static cn_status mark(const job *j, const char *what)
{
    char hex[17], *path = marker_path(j, j->stage, what);
    cn_hash_hex(j->chain, hex);
    json_t *root = json_pack("{s:i, s:s, s:s}", "version", MARKER_VERSION, "stage", j->stage, "work", hex);
    cn_status status = path && root ? cn_json_save(root, path) : cn_fail(CN_ERR_NOMEM, "out of memory");
    json_decref(root);
    free(path);
    return status;
}

static cn_status mark_done(const job *j)
{
    return mark(j, "done");
}

static cn_status remove_marker(const job *j, const char *stage, const char *what)
{
    char *path = marker_path(j, stage, what);
    cn_status status = path ? cn_file_remove(path) : cn_fail(CN_ERR_NOMEM, "out of memory");
    free(path);
    return status;
}

static cn_status unmark(const job *j)
{
    return remove_marker(j, j->stage, "done");
}

static void begin(job *j, const char *stage, double total)
{
    j->stage = stage;
    j->started_s = cn_now_s();
    j->advanced_s = j->started_s;
    j->told_s = -INFINITY;
    j->base = j->done = j->step_s = 0.0;
    j->left_s = -1.0;
    j->part = j->total = total;
}

static void mix(job *j, const void *data, size_t size)
{
    uint64_t both[2] = { j->chain, cn_hash64(data, size) };
    j->chain = cn_hash64(both, sizeof both);
}

static cn_status remove_database(const job *j)
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

static cn_status write_list(const job *j, const char *path, const uint32_t *photos, uint32_t n)
{
    char *text = NULL;
    size_t size = 0;
    FILE *stream = open_memstream(&text, &size);
    bool fine = stream != NULL;
    for (uint32_t i = 0; i < n && fine; i++) {
        char *name = cn_colmap_name(j->index, j->linked, photos[i]);
        fine = name && fprintf(stream, "%s\n", name) > 0;
        free(name);
    }
    if (stream && fclose(stream) != 0) fine = false;
    cn_status status = fine ? cn_file_write(path, text, size) : cn_fail(CN_ERR_NOMEM, "out of memory listing photos");
    free(text);
    return status;
}

static cn_status extract(job *j, const uint32_t *photos, const cn_lens_group *group, const char *list)
{
    char size[16], features[16];
    int exit_code;
    CN_TRY(write_list(j, list, photos + group->first, group->n));
    snprintf(size, sizeof size, "%u", j->options->max_image_px);
    snprintf(features, sizeof features, "%u", j->options->max_features);
    const char *const argv[] = { j->options->colmap,
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
                                 group->shared && group->n >= MANY_PHOTOS ? "OPENCV" : "SIMPLE_RADIAL",
                                 "--SiftExtraction.use_gpu",
                                 "0",
                                 "--SiftExtraction.num_threads",
                                 j->threads,
                                 "--SiftExtraction.max_image_size",
                                 size,
                                 "--SiftExtraction.max_num_features",
                                 features,
                                 NULL };
    CN_TRY(run(j, argv, &exit_code));
    return exit_code ? failed(j, exit_code) : CN_OK;
}

/* Links named by number, for photos whose names do not work in COLMAP's lists. */
static cn_status make_links(const job *j)
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

static cn_status stage_features(job *j)
{
    begin(j, "features", j->index->n_photos);
    const uint32_t settings[] = { j->options->max_image_px, j->options->max_features, j->options->single_camera };
    mix(j, settings, sizeof settings);
    for (uint32_t i = 0; i < j->index->n_photos; i++) {
        mix(j, j->index->photos[i].name, strlen(j->index->photos[i].name));
        mix(j, &j->index->photos[i].hash, sizeof j->index->photos[i].hash);
    }
    if (is_done(j) && cn_file_exists(j->database)) return CN_OK;
    cn_lens_groups groups = { 0 };
    char *list = cn_path_join(j->dir, "photos.txt");
    cn_status status = list ? unmark(j) : cn_fail(CN_ERR_NOMEM, "out of memory");
    if (status == CN_OK) status = remove_marker(j, "matches", "begun");
    if (status == CN_OK) status = remove_marker(j, "matches", "done");
    if (status == CN_OK) status = remove_database(j);
    if (status == CN_OK && j->linked) status = make_links(j);
    if (status == CN_OK) status = cn_colmap_group(j->index, j->options->single_camera, &groups);
    for (uint32_t i = 0; i < groups.n_groups && status == CN_OK; i++)
        status = extract(j, groups.order, &groups.groups[i], list);
    cn_lens_groups_deinit(&groups);
    free(list);
    return status == CN_OK ? mark_done(j) : status;
}

/* COLMAP skips pairs that are in the database. Keep those of a killed run with the same inputs; remove those of other
 * inputs, such as another matcher. */
static cn_status begin_matches(job *j)
{
    char *begun = marker_path(j, j->stage, "begun"), *done = marker_path(j, j->stage, "done");
    const bool room = begun && done, fresh = room && !cn_file_exists(begun) && !cn_file_exists(done);
    free(begun);
    free(done);
    if (!room) return cn_fail(CN_ERR_NOMEM, "out of memory");
    CN_TRY(unmark(j));
    if (is_marked(j, "begun")) {
        cn_log(j->ctx, CN_LOG_INFO, "matching resumes with the matches of an earlier run");
        return CN_OK;
    }
    if (!fresh) {
        int exit_code;
        const char *const argv[] = { j->options->colmap, "database_cleaner", "--type", "matches",
                                     "--database_path",  j->database,        NULL };
        CN_TRY(remove_marker(j, j->stage, "begun"));
        CN_TRY(run(j, argv, &exit_code));
        if (exit_code) return failed(j, exit_code);
    }
    return mark(j, "begun");
}

static cn_status match(job *j, const char *command, const char *const *extra)
{
    const char *argv[MOST_WORDS] = {
        j->options->colmap,           command,   "--database_path", j->database, "--SiftMatching.use_gpu", "0",
        "--SiftMatching.num_threads", j->threads
    };
    int n = 8, exit_code;
    for (; extra && *extra; extra++)
        argv[n++] = *extra;
    CN_TRY(run(j, argv, &exit_code));
    return exit_code ? failed(j, exit_code) : CN_OK;
}

static cn_matcher choose_matcher(const job *j)
{
    if (j->options->matcher != CN_MATCH_AUTO) return j->options->matcher;
    return 2 * (uint64_t)j->index->n_gps > j->index->n_photos ? CN_MATCH_GPS : CN_MATCH_EXHAUSTIVE;
}

/* One part of the list at a time, because COLMAP saves its matches at the end of a list. */
static cn_status match_parts(job *j, const char *path, const char *text, size_t size)
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
        tell(j, j->base);
        at = next;
    }
    return CN_OK;
}

static cn_status match_pairs(job *j, const char *text, size_t size, uint64_t n_pairs)
{
    mix(j, text, size);
    if (is_done(j)) return CN_OK;
    char *path = cn_path_join(j->dir, "pairs.txt");
    if (!path) return cn_fail(CN_ERR_NOMEM, "out of memory");
    cn_log(j->ctx, CN_LOG_INFO, "matching %llu pairs of neighbours by GPS", (unsigned long long)n_pairs);
    begin(j, "matches", (double)n_pairs);
    cn_status status = begin_matches(j);
    if (status == CN_OK) status = match_parts(j, path, text, size);
    free(path);
    return status == CN_OK ? mark_done(j) : status;
}

/* Matches every pair; for a film, each photo with the next ones. */
static cn_status match_all(job *j, cn_matcher matcher)
{
    const uint32_t n = j->index->n_photos;
    mix(j, &matcher, sizeof matcher);
    if (is_done(j)) return CN_OK;
    begin(j, "matches", matcher == CN_MATCH_SEQUENTIAL ? n : 0.5 * n * (n - 1.0));
    CN_TRY(begin_matches(j));
    if (matcher == CN_MATCH_SEQUENTIAL) {
        CN_TRY(match(j, "sequential_matcher", NULL));
        return mark_done(j);
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
    return mark_done(j);
}

static cn_status stage_matches(job *j)
{
    char *text = NULL;
    size_t size = 0;
    uint64_t n_pairs = 0;
    cn_matcher matcher = choose_matcher(j);
    begin(j, "matches", 0.0);
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

static cn_status map(job *j, bool fix_focal, const char *sparse)
{
    int exit_code;
    const char *const argv[] = { j->options->colmap,
                                 "mapper",
                                 "--database_path",
                                 j->database,
                                 "--image_path",
                                 j->images,
                                 "--output_path",
                                 sparse,
                                 "--Mapper.num_threads",
                                 j->threads,
                                 "--Mapper.ba_refine_focal_length",
                                 fix_focal ? "0" : "1",
                                 "--Mapper.ba_refine_principal_point",
                                 "0",
                                 NULL };
    CN_TRY(unmark(j));
    CN_TRY(cn_model_remove(sparse));
    CN_TRY(cn_folder_make(sparse));
    CN_TRY(run(j, argv, &exit_code));
    /* Other exit codes may also mean that there is no model; that is checked below. */
    return exit_code > 128 ? failed(j, exit_code) : CN_OK;
}

static cn_status map_and_choose(job *j, bool fix_focal, const char *sparse, char **model, uint32_t *n_models)
{
    if (is_done(j)) CN_TRY(cn_colmap_find_model(sparse, model, n_models));
    if (*model) return CN_OK;
    CN_TRY(map(j, fix_focal, sparse));
    CN_TRY(cn_colmap_find_model(sparse, model, n_models));
    if (*model) return mark_done(j);
    return cn_fail(CN_ERR_DATA,
                   "COLMAP finds no poses for these %u photos: they overlap too little, show too little texture or "
                   "were taken at one place; add photos in between (see %s)",
                   j->index->n_photos, j->log);
}

static cn_status stage_mapping(job *j, bool fix_focal, char **model, uint32_t *n_models)
{
    begin(j, fix_focal ? "mapping-fixed-focal" : "mapping", j->index->n_photos);
    mix(j, j->stage, strlen(j->stage));
    char *sparse = cn_format("%s/sparse%s", j->dir, fix_focal ? "-fixed-focal" : "");
    cn_status status =
        sparse ? map_and_choose(j, fix_focal, sparse, model, n_models) : cn_fail(CN_ERR_NOMEM, "out of memory");
    free(sparse);
    return status;
}

/* OPENCV with its tangential terms bends a straight-down block of photos into a bowl. True when a camera was replaced.
 */
static bool simplify_lenses(cn_scene *scene)
{
    bool changed = false;
    for (uint32_t i = 0; i < scene->n_cameras; i++) {
        cn_camera *camera = &scene->cameras[i];
        if (camera->lens != CN_LENS_OPENCV) continue;
        const cn_lens_view full = cn_lens_unpack(camera);
        const cn_lens_view simple = { .fx = full.fx, .fy = full.fx, .cx = full.cx, .cy = full.cy, .k = { full.k[0] } };
        camera->lens = CN_LENS_SIMPLE_RADIAL;
        cn_lens_pack(&simple, camera);
        changed = true;
    }
    return changed;
}

static cn_status adjust(job *j, const char *input, const char *output)
{
    int exit_code;
    const char *const argv[] = { j->options->colmap,
                                 "bundle_adjuster",
                                 "--input_path",
                                 input,
                                 "--output_path",
                                 output,
                                 "--BundleAdjustment.refine_focal_length",
                                 "0",
                                 "--BundleAdjustment.max_num_iterations",
                                 "200",
                                 NULL };
    CN_TRY(unmark(j));
    CN_TRY(cn_model_remove(output));
    CN_TRY(cn_folder_make(output));
    CN_TRY(run(j, argv, &exit_code));
    return exit_code ? failed(j, exit_code) : mark_done(j);
}

static cn_status adjust_simple(job *j, cn_scene *scene, char **model)
{
    char *input = cn_path_join(j->dir, "sparse-simple-lens-start");
    char *output = cn_path_join(j->dir, "sparse-simple-lens");
    cn_status status = input && output ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory");
    if (status == CN_OK && !(is_done(j) && cn_model_photos(output))) {
        status = cn_scene_write_colmap(scene, input);
        if (status == CN_OK) status = adjust(j, input, output);
    }
    free(input);
    if (status != CN_OK) {
        free(output);
        return status;
    }
    free(*model);
    *model = output;
    return CN_OK;
}

/* When the focal length is given, one radial term is enough, and it cannot bend the ground. */
static cn_status stage_simple_lens(job *j, char **model)
{
    cn_scene scene;
    begin(j, "mapping-simple-lens", 0.0);
    mix(j, j->stage, strlen(j->stage));
    CN_TRY(cn_scene_read_colmap(&scene, *model));
    cn_status status = simplify_lenses(&scene) ? adjust_simple(j, &scene, model) : CN_OK;
    cn_scene_deinit(&scene);
    return status;
}

static cn_status poses(job *j, bool fix_focal, bool simple_lens, char **model, uint32_t *n_models)
{
    CN_TRY(cn_process_end_stray(j->ctx, j->note));
    CN_TRY(stage_features(j));
    CN_TRY(stage_matches(j));
    CN_TRY(stage_mapping(j, fix_focal, model, n_models));
    return simple_lens ? stage_simple_lens(j, model) : CN_OK;
}

cn_status cn_colmap_poses(const cn_context *ctx, const cn_photo_index *index, const char *dir,
                          const cn_pose_options *options, bool fix_focal, bool simple_lens, char **model,
                          uint32_t *n_models)
{
    job j = { .ctx = ctx, .index = index, .options = options, .dir = dir, .linked = cn_colmap_needs_links(index) };
    snprintf(j.threads, sizeof j.threads, "%u", cn_pool_threads(ctx ? ctx->pool : NULL));
    j.log = cn_path_join(dir, "colmap.log");
    j.database = cn_path_join(dir, "database.db");
    j.images = j.linked ? cn_path_join(dir, "links") : strdup(index->folder);
    j.note = cn_path_join(dir, "colmap.pid");
    *model = NULL;
    *n_models = 0;
    const bool room = j.log && j.database && j.images && j.note;
    cn_status status =
        room ? poses(&j, fix_focal, simple_lens, model, n_models) : cn_fail(CN_ERR_NOMEM, "out of memory");
    free(j.log);
    free(j.database);
    free(j.images);
    free(j.note);
    if (status != CN_OK) {
        free(*model);
        *model = NULL;
    }
    return status;
}
