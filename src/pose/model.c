/* Reads and writes COLMAP model folders, binary and text. */
#include "base/file.h"
#include "math/linalg.h"
#include "pose/lens.h"
#include "pose/scene.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static bool has(const char *dir, const char *name)
{
    char *path = cn_path_join(dir, name);
    bool there = path && cn_file_exists(path);
    free(path);
    return there;
}

bool cn_model_is_binary(const char *dir)
{
    return has(dir, "cameras.bin") || has(dir, "images.bin");
}

cn_status cn_model_read(cn_scene *scene, const char *dir, double *lens_fit_px)
{
    cn_raw_model raw = { 0 };
    cn_status status;
    memset(scene, 0, sizeof *scene);
    if (cn_model_is_binary(dir))
        status = cn_raw_read_binary(&raw, dir);
    else if (has(dir, "cameras.txt") || has(dir, "images.txt"))
        status = cn_raw_read_text(&raw, dir);
    else
        status = cn_fail(CN_ERR_IO,
                         "%s: no COLMAP model here; a model folder holds cameras, images and points3D as "
                         ".bin or .txt",
                         dir);
    if (status == CN_OK) status = cn_scene_from_raw(scene, &raw, dir);
    if (lens_fit_px) *lens_fit_px = raw.lens_fit_px;
    cn_raw_model_deinit(&raw);
    return status;
}

cn_status cn_scene_read_colmap(cn_scene *scene, const char *dir)
{
    return cn_model_read(scene, dir, NULL);
}

/* images.bin begins with the number of photos. Text models are rare, so they are read completely. */
uint32_t cn_model_photos(const char *dir)
{
    uint64_t n = 0;
    char *path = cn_path_join(dir, "images.bin");
    FILE *file = path ? fopen(path, "rb") : NULL;
    free(path);
    if (file) {
        if (fread(&n, sizeof n, 1, file) != 1) n = 0;
        fclose(file);
        return n < UINT32_MAX ? (uint32_t)n : 0;
    }
    cn_scene scene;
    if (!has(dir, "images.txt") || cn_scene_read_colmap(&scene, dir) != CN_OK) return 0;
    n = scene.n_views;
    cn_scene_deinit(&scene);
    return (uint32_t)n;
}

static bool put(cn_writer *writer, const void *data, size_t size)
{
    return fwrite(data, 1, size, writer->stream) == size;
}

static bool put64(cn_writer *writer, uint64_t value)
{
    return put(writer, &value, sizeof value);
}

static bool put32(cn_writer *writer, uint32_t value)
{
    return put(writer, &value, sizeof value);
}

/* The index of each observation among its photo's keypoints, which are in the order of the points. */
typedef struct layout {
    uint64_t *count, *start, *order;
    uint32_t *point_of;
} layout;

static bool write_cameras(cn_writer *writer, const cn_scene *scene, const layout *unused)
{
    (void)unused;
    bool fine = put64(writer, scene->n_cameras);
    for (uint32_t i = 0; i < scene->n_cameras && fine; i++) {
        const cn_camera *camera = &scene->cameras[i];
        fine = put32(writer, i + 1) && put32(writer, (uint32_t)camera->lens) && put64(writer, camera->width) &&
               put64(writer, camera->height) &&
               put(writer, camera->params, (size_t)cn_lens_params(camera->lens) * sizeof(double));
    }
    return fine;
}

static bool write_keypoints(cn_writer *writer, const cn_scene *scene, const layout *at, uint32_t view)
{
    bool fine = put64(writer, at->count[view]);
    for (uint64_t i = 0; i < at->count[view] && fine; i++) {
        uint64_t seen = at->order[at->start[view] + i];
        double xy[2] = { scene->observations[seen].x_px, scene->observations[seen].y_px };
        fine = put(writer, xy, sizeof xy) && put64(writer, (uint64_t)at->point_of[seen] + 1);
    }
    return fine;
}

static bool write_images(cn_writer *writer, const cn_scene *scene, const layout *at)
{
    bool fine = put64(writer, scene->n_views);
    for (uint32_t i = 0; i < scene->n_views && fine; i++) {
        const cn_view *view = &scene->views[i];
        double quaternion[4];
        cn_mat3_to_quat(view->rotation, quaternion);
        fine = put32(writer, i + 1) && put(writer, quaternion, sizeof quaternion) &&
               put(writer, view->translation, sizeof view->translation) && put32(writer, view->camera + 1) &&
               put(writer, view->name, strlen(view->name) + 1) && write_keypoints(writer, scene, at, i);
    }
    return fine;
}

static bool write_track(cn_writer *writer, const cn_scene *scene, const cn_point *point, uint64_t *cursor)
{
    bool fine = put64(writer, point->n_observations);
    for (uint32_t j = 0; j < point->n_observations && fine; j++) {
        uint32_t view = scene->observations[(uint64_t)point->first_observation + j].view;
        fine = put32(writer, view + 1) && put32(writer, (uint32_t)cursor[view]++);
    }
    return fine;
}

static bool write_points(cn_writer *writer, const cn_scene *scene, const layout *at)
{
    bool fine = put64(writer, scene->n_points);
    memset(at->count, 0, scene->n_views * sizeof *at->count); /* the last file: count is free to count again */
    for (uint32_t i = 0; i < scene->n_points && fine; i++) {
        const cn_point *point = &scene->points[i];
        double error = point->error_px;
        fine = put64(writer, (uint64_t)i + 1) && put(writer, point->xyz, sizeof point->xyz) &&
               put(writer, point->rgb, 3) && put(writer, &error, sizeof error) &&
               write_track(writer, scene, point, at->count);
    }
    return fine;
}

static cn_status write_file(const cn_scene *scene, const layout *at, const char *dir, const char *name,
                            bool (*write)(cn_writer *, const cn_scene *, const layout *))
{
    cn_writer writer = { 0 };
    char *path = cn_path_join(dir, name);
    if (!path) return cn_fail(CN_ERR_NOMEM, "%s: out of memory", dir);
    cn_status status = cn_writer_open(&writer, path);
    if (status == CN_OK && !write(&writer, scene, at))
        status = cn_fail(CN_ERR_IO, "%s: writing failed; is the disk full?", path);
    if (status == CN_OK) status = cn_writer_commit(&writer);
    cn_writer_abort(&writer);
    free(path);
    return status;
}

static void lay_out(const cn_scene *scene, layout *at)
{
    for (uint64_t i = 0; i < scene->n_observations; i++)
        at->count[scene->observations[i].view]++;
    for (uint32_t i = 1; i < scene->n_views; i++)
        at->start[i] = at->start[i - 1] + at->count[i - 1];
    memset(at->count, 0, scene->n_views * sizeof *at->count);
    for (uint32_t i = 0; i < scene->n_points; i++) {
        const cn_point *point = &scene->points[i];
        for (uint32_t j = 0; j < point->n_observations; j++) {
            uint64_t seen = (uint64_t)point->first_observation + j;
            uint32_t view = scene->observations[seen].view;
            at->order[at->start[view] + at->count[view]++] = seen;
            at->point_of[seen] = i;
        }
    }
}

cn_status cn_scene_write_colmap(const cn_scene *scene, const char *dir)
{
    layout at = { calloc(scene->n_views + (size_t)1, 8), calloc(scene->n_views + (size_t)1, 8),
                  calloc(scene->n_observations + 1, 8), calloc(scene->n_observations + 1, 4) };
    cn_status status = CN_OK;
    if (!at.count || !at.start || !at.order || !at.point_of) status = cn_fail(CN_ERR_NOMEM, "%s: out of memory", dir);
    if (status == CN_OK) status = cn_folder_make(dir);
    if (status == CN_OK) {
        lay_out(scene, &at);
        status = write_file(scene, &at, dir, "cameras.bin", write_cameras);
    }
    if (status == CN_OK) status = write_file(scene, &at, dir, "images.bin", write_images);
    if (status == CN_OK) status = write_file(scene, &at, dir, "points3D.bin", write_points);
    free(at.count);
    free(at.start);
    free(at.order);
    free(at.point_of);
    return status;
}
