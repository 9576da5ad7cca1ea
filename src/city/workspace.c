#include "city/workspace.h"

#include "base/file.h"
#include "photo/store.h"

#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

char *cn_city_path(const cn_city *city, const char *name)
{
    return cn_path_join(city->folder, name);
}
const char *cn_city_folder(const cn_city *city)
{
    return city->folder;
}

cn_status cn_city_open(cn_city **city, const char *folder)
{
    *city = calloc(1, sizeof **city);
    if (!*city) return cn_fail(CN_ERR_NOMEM, "out of memory while opening %s", folder);
    cn_status status = cn_path_absolute(folder, &(*city)->folder);
    if (status != CN_OK)
        status =
            cn_fail(CN_ERR_USAGE, "%s is not there; make a city with `conurb init %s --photos DIR`", folder, folder);
    if (status == CN_OK) status = cn_config_load(&(*city)->config, (*city)->folder);
    if (status != CN_OK) cn_city_close(city);
    return status;
}

void cn_city_close(cn_city **city)
{
    if (!*city) return;
    cn_config_deinit(&(*city)->config);
    free((*city)->folder);
    free(*city);
    *city = NULL;
}

static cn_status already(const char *city)
{
    return cn_fail(CN_ERR_USAGE, "%s already is a city; edit its city.yaml, or choose another name", city);
}

/* Remove a workspace that could not be finished, so that `init` can be tried again. */
static cn_status write_city(const cn_context *ctx, const char *folder, const char *photos, const char *import,
                            uint32_t width_px)
{
    char *path = cn_path_join(folder, "city.yaml");
    char *text = cn_config_template(photos, import, width_px ? width_px : 800);
    cn_status status = path && text ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory while making %s", folder);
    if (status == CN_OK && cn_file_exists(path)) status = already(folder);
    if (status == CN_OK) status = cn_folder_make(folder);
    if (status == CN_OK) status = cn_file_write(path, text, strlen(text));
    if (status == CN_OK) cn_log(ctx, CN_LOG_INFO, "made %s", path);
    free(text);
    free(path);
    return status;
}

/* CITY/photos, with photos of the film. Caller frees the path. */
static cn_status take_photos(const cn_context *ctx, const char *city, const cn_init_options *options, char **photos)
{
    size_t n;
    char *yaml = cn_path_join(city, "city.yaml"), *folder = cn_path_join(city, "photos");
    cn_status status = yaml && folder ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory while making %s", city);
    if (status == CN_OK && cn_file_exists(yaml)) status = already(city);
    if (status == CN_OK) status = cn_video_take_photos(ctx, options->video, folder, &options->film, &n);
    if (status == CN_OK) status = cn_path_absolute(folder, photos);
    free(yaml);
    free(folder);
    return status;
}

static cn_status find_photos(const char *folder, char **photos)
{
    struct stat st;
    if (stat(folder, &st) == 0 && !S_ISDIR(st.st_mode))
        return cn_fail(
            CN_ERR_DATA,
            "%s is a file, not the folder that holds the photos; unpack an archive first, and give a film by "
            "--video",
            folder);
    if (cn_path_absolute(folder, photos) == CN_OK) return CN_OK;
    return cn_fail(CN_ERR_DATA, "the photo folder %s is not there; name the folder that holds the photos", folder);
}

cn_status cn_city_init(const cn_context *ctx, const char *city, const cn_init_options *options)
{
    if (!options->photos && !options->video)
        return cn_fail(CN_ERR_USAGE,
                       "--photos DIR is missing: name the folder that holds the photos, or a film by --video");
    if (options->photos && options->video)
        return cn_fail(CN_ERR_USAGE, "give --photos or --video, not both; photos of a film go to %s/photos", city);
    if (options->width_px && (options->width_px < 16 || options->width_px > 65535))
        return cn_fail(CN_ERR_USAGE, "--width %u: give 16 to 65535 pixels", options->width_px);
    char *photos = NULL, *import = NULL;
    cn_status status = CN_OK;
    if (options->import && cn_path_absolute(options->import, &import) != CN_OK)
        status =
            cn_fail(CN_ERR_DATA, "%s is not there; name a COLMAP model folder or a file of poses", options->import);
    if (status == CN_OK)
        status = options->video ? take_photos(ctx, city, options, &photos) : find_photos(options->photos, &photos);
    if (status == CN_OK) status = write_city(ctx, city, photos, import, options->width_px);
    free(photos);
    free(import);
    return status;
}

static cn_status load_one(const cn_city *city, const char *name, const char *command, char **path)
{
    *path = cn_city_path(city, name);
    if (!*path) return cn_fail(CN_ERR_NOMEM, "out of memory");
    if (cn_file_exists(*path)) return CN_OK;
    free(*path);
    *path = NULL;
    return cn_fail(CN_ERR_DATA, "%s has no %s yet; run `conurb %s %s` first", city->folder, name, command,
                   city->folder);
}

static cn_status load_all(const cn_context *ctx, const cn_city *city, bool with_plan, cn_dataset *m)
{
    char *path;
    CN_TRY(load_one(city, "photos.json", "poses", &path));
    cn_status status = cn_photo_index_load(&m->photos, path);
    free(path);
    CN_TRY(status);
    uint32_t n_maps;
    CN_TRY(cn_photo_index_find_maps(&m->photos, &city->config.maps, &n_maps));
    CN_TRY(load_one(city, "frame.json", "poses", &path));
    status = cn_frame_load(&m->frame, path);
    free(path);
    CN_TRY(status);
    CN_TRY(load_one(city, "poses", "poses", &path));
    status = cn_pose_load(ctx, path, &m->photos, &m->scene);
    free(path);
    CN_TRY(status);
    if (!with_plan) return CN_OK;
    CN_TRY(load_one(city, "plan/plan.json", "plan", &path));
    free(path);
    path = cn_city_path(city, "pixels.bin");
    if (!path) return cn_fail(CN_ERR_NOMEM, "out of memory");
    status = cn_file_exists(path) ? cn_pixel_store_open(&m->pixels, path) : CN_OK;
    free(path);
    CN_TRY(status);
    path = cn_city_path(city, "plan");
    status = path ? cn_plan_load(&m->plan, &m->scene, path) : cn_fail(CN_ERR_NOMEM, "out of memory");
    free(path);
    return status;
}

cn_status cn_dataset_load(const cn_context *ctx, const cn_city *city, bool with_plan, cn_dataset *dataset)
{
    *dataset = (cn_dataset){ .city = city };
    const cn_status status = load_all(ctx, city, with_plan, dataset);
    if (status != CN_OK) cn_dataset_deinit(dataset);
    return status;
}

cn_status cn_dataset_need_pixels(const cn_dataset *dataset)
{
    const char *folder = dataset->city->folder;
    if (dataset->pixels) return CN_OK;
    return cn_fail(CN_ERR_DATA, "%s has no pixels.bin, its photos at their working width; run `conurb plan %s` first",
                   folder, folder);
}

cn_status cn_dataset_pixels_current(const cn_dataset *dataset, bool *current)
{
    char *pixels = cn_city_path(dataset->city, "pixels.bin");
    const cn_status status =
        pixels ? cn_pixel_store_is_done(&dataset->photos, dataset->city->config.width_px, pixels, current)
               : cn_fail(CN_ERR_NOMEM, "out of memory");
    free(pixels);
    return status;
}

void cn_dataset_deinit(cn_dataset *dataset)
{
    cn_plan_deinit(&dataset->plan);
    cn_pixel_store_close(&dataset->pixels);
    cn_scene_deinit(&dataset->scene);
    cn_photo_index_deinit(&dataset->photos);
    *dataset = (cn_dataset){ 0 };
}
