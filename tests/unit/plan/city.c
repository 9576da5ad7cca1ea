#include "city.h"

#include "../common.h"
#include "base/file.h"

void city_init(city *c, uint32_t n_views, uint32_t n_points, uint32_t n_observations)
{
    memset(c, 0, sizeof *c);
    cn_scene *s = &c->scene;
    s->cameras = calloc(1, sizeof *s->cameras);
    s->views = calloc(n_views + 1, sizeof *s->views);
    s->points = calloc(n_points + 1, sizeof *s->points);
    s->observations = calloc(n_observations + 1, sizeof *s->observations);
    c->photos.photos = calloc(n_views + 1, sizeof *c->photos.photos);
    assert_non_null(s->observations);
    s->cameras[0] =
        (cn_camera){ .id = 1, .lens = CN_LENS_PINHOLE, .width = 400, .height = 300, .params = { 300, 300, 200, 150 } };
    s->n_cameras = 1;
    cn_frame_init(&c->frame);
    strcpy(c->folder, "/tmp/conurb-plan-XXXXXX");
    assert_non_null(mkdtemp(c->folder));
}

void city_deinit(city *c)
{
    cn_scene_deinit(&c->scene);
    free(c->photos.photos);
    assert_int_equal(folder_remove(c->folder), 0);
}

static void add_view(city *c, const double centre[3], const double right[3], const double down[3],
                     const double forward[3])
{
    cn_view *v = &c->scene.views[c->scene.n_views];
    const double *rows[3] = { right, down, forward };
    for (int r = 0; r < 3; r++)
        for (int k = 0; k < 3; k++) {
            v->rotation[3 * r + k] = rows[r][k];
            v->translation[r] -= rows[r][k] * centre[k];
        }
    v->name = cn_format("%05u.jpg", c->scene.n_views);
    v->photo = c->scene.n_views++;
    c->photos.photos[v->photo] =
        (cn_photo){ .name = v->name, .width = 400, .height = 300, .exposure_s = 0.01, .iso = 100, .f_number = 4 };
    c->photos.n_photos++;
}

void city_look_down(city *c, double x, double y, double z)
{
    add_view(c, (double[]){ x, y, z }, (double[]){ 1, 0, 0 }, (double[]){ 0, -1, 0 }, (double[]){ 0, 0, -1 });
}

void city_look_along(city *c, double x, double y, double z, double dx, double dy)
{
    const double length = hypot(dx, dy), f[3] = { dx / length, dy / length, 0 };
    add_view(c, (double[]){ x, y, z }, (double[]){ f[1], -f[0], 0 }, (double[]){ 0, 0, -1 }, f);
}

void city_point(city *c, double x, double y, double z, uint32_t first, uint32_t last)
{
    cn_scene *s = &c->scene;
    cn_point *p = &s->points[s->n_points++];
    *p = (cn_point){ .xyz = { x, y, z },
                     .rgb = { 90, 120, 60 },
                     .first_observation = (uint32_t)s->n_observations,
                     .n_observations = last - first + 1 };
    for (uint32_t v = first; v <= last; v++)
        s->observations[s->n_observations++] = (cn_observation){ v, 200, 150 };
}

void city_georeference(city *c, double latitude_deg, double longitude_deg)
{
    c->frame.georeferenced = true;
    c->frame.latitude_deg = latitude_deg;
    c->frame.longitude_deg = longitude_deg;
    c->frame.height_m = 100;
}

void city_survey(city *c, uint32_t n, double step, double h)
{
    city_init(c, n * n, n * n, 2 * n * n);
    for (uint32_t i = 0; i < n * n; i++)
        city_look_down(c, step * (i % n), step * (i / n), h);
    for (uint32_t i = 0; i < n * n; i++)
        city_point(c, step * (i % n), step * (i / n), 0, i, i + 1 < n * n ? i + 1 : i);
}

cn_status city_try(const city *c, const cn_plan_options *options, cn_plan *plan)
{
    const cn_plan_input input = { &c->scene, &c->photos, &c->frame, NULL };
    return cn_plan_make(NULL, &input, options, plan);
}

void city_plan(const city *c, const cn_plan_options *options, cn_plan *plan)
{
    if (city_try(c, options, plan) != CN_OK) fail_msg("%s", cn_error_message());
}

bool tile_has(const uint32_t *list, uint32_t n, uint32_t view)
{
    for (uint32_t i = 0; i < n; i++)
        if (list[i] == view) return true;
    return false;
}

bool warned(const cn_plan *plan, const char *words)
{
    for (uint32_t i = 0; i < plan->n_warnings; i++)
        if (strstr(plan->warnings[i], words)) return true;
    return false;
}
