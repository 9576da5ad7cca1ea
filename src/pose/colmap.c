#include "pose/colmap.h"

#include "base/file.h"
#include "base/number.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#define MANY_PHOTOS 10 /* photos that must share a lens before all of OPENCV's parameters are estimated */

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
    const bool known = group->focal_px > 0.0;
    const cn_photo *example = &j->index->photos[photos[group->first]];
    char size[16], features[16], existing[16], lens[96];
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
                                 known  ? "SIMPLE_PINHOLE"
                                 : full ? "OPENCV"
                                        : "SIMPLE_RADIAL",
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
    cn_print(lens, sizeof lens, "%.9g,%.9g,%.9g", group->focal_px, 0.5 * example->width, 0.5 * example->height);
    const char *const exact[] = { "--ImageReader.camera_params", lens, NULL };
    if (known) cn_job_words(argv, &n, exact);
    if (camera) cn_job_words(argv, &n, reuse);
    CN_TRY(cn_job_run(j, argv, &exit_code));
    return exit_code ? cn_job_failed(j, exit_code) : CN_OK;
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
    if (status == CN_OK && j->linked) status = cn_colmap_show_photos(j);
    if (status == CN_OK) status = cn_colmap_group(j->index, j->options->single_camera, &groups);
    if (status == CN_OK) status = begin_features(j, &groups, &cameras);
    if (status == CN_OK) status = extract_groups(j, &groups, cameras);
    cn_lens_groups_deinit(&groups);
    free(cameras);
    return status == CN_OK ? cn_job_mark_done(j) : status;
}
