#include "stage/camera_path.h"

#include "stage/survey.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* A photo's own view at the render's width. */
static cn_status photo_path(const cn_dataset *m, const char *photo_name, uint32_t width, cn_path *path)
{
    const int64_t photo = cn_photo_index_find(&m->photos, photo_name);
    for (uint32_t i = 0; photo >= 0 && i < m->scene.n_views; i++) {
        const cn_view *v = &m->scene.views[i];
        if (v->photo != (uint32_t)photo) continue;
        const cn_camera *c = &m->scene.cameras[v->camera];
        path->frames = calloc(1, sizeof *path->frames);
        if (!path->frames) return cn_fail(CN_ERR_NOMEM, "out of memory");
        path->n_frames = 1;
        cn_camera_resize(c, width, (uint32_t)fmax(1, round((double)c->height * width / c->width)),
                         &path->frames[0].camera);
        path->frames[0].view = *v;
        path->frames[0].view.name = strdup(v->name);
        return CN_OK;
    }
    return cn_fail(CN_ERR_USAGE, "photo '%s' has no pose; see photos.json and poses/ for those that have", photo_name);
}

/* The picture has the aspect ratio of the first photo, as it stands upright. */
static uint32_t height_for(const cn_scene *scene, uint32_t width)
{
    const cn_camera *c = &scene->cameras[scene->views[0].camera];
    const cn_side up = cn_view_side_up(&scene->views[0]);
    const bool on_side = up == CN_SIDE_LEFT || up == CN_SIDE_RIGHT;
    const double aspect = on_side ? (double)c->width / c->height : (double)c->height / c->width;
    /* Even, because a video encoder needs it. */
    return (uint32_t)fmax(2, round(aspect * width / 2)) * 2;
}

static cn_status choose(const cn_context *ctx, cn_city *city, const cn_dataset *m,
                        const cn_city_render_options *options, cn_path *path)
{
    const cn_config *c = &city->config;
    const uint32_t width = options->width_px ? options->width_px : c->render_width_px;
    const uint32_t frames = options->n_frames ? options->n_frames : c->render_frames;
    /* For a file named "photos" give "./photos". */
    const bool by_photos = options->path && strcmp(options->path, "photos") == 0;
    if ((options->path != NULL) + (options->photo != NULL) + (options->orbit != NULL) > 1)
        return cn_fail(CN_ERR_USAGE, "--path, --photo and --orbit exclude each other; give one");
    path->fps = c->render_fps;
    if (options->photo) return photo_path(m, options->photo, width, path);
    if (!m->scene.n_views) return cn_fail(CN_ERR_DATA, "no photo has a pose; there is nothing to fly over");
    cn_path_options o = cn_path_options_default();
    o.frame = &m->frame;
    o.width = width;
    o.height = height_for(&m->scene, width);
    o.n_frames = options->n_frames;
    o.fps = c->render_fps;
    cn_city_height_sampler sounder = { ctx, city, m };
    o.sound = cn_city_heights;
    o.sound_user = &sounder;
    if (options->height_m != 0) o.height_m = options->height_m;
    if (options->path && !by_photos) return cn_path_load(path, options->path, &o);
    o.n_frames = frames;
    if (options->orbit) return cn_path_orbit(path, options->orbit, &o);
    if (options->path) return cn_path_photos(path, &m->scene, &o);
    CN_TRY(cn_path_default(path, &m->scene, frames, width, o.height));
    path->fps = c->render_fps;
    return CN_OK;
}

cn_status cn_route_choose(const cn_context *ctx, cn_city *city, const cn_dataset *m,
                          const cn_city_render_options *options, cn_path *path)
{
    const bool around = options->camera && strcmp(options->camera, "equirectangular") == 0;
    if (options->camera && !around && strcmp(options->camera, "pinhole") != 0)
        return cn_fail(CN_ERR_USAGE, "--camera %s: give pinhole or equirectangular", options->camera);
    CN_TRY(choose(ctx, city, m, options, path));
    return around ? cn_path_look_around(path) : CN_OK;
}
