#include "align_city.h"

#include "base/rng.h"

#include <stdlib.h>

const double QUATERNION[4] = { 0.3, -0.5, 0.7, 0.2 };
const double SCALE = 3.7, SHIFT[3] = { 12, -400, 31 };

double uniform(uint64_t counter)
{
    return 2.0 * cn_rng_float(5, 6, counter) - 1.0;
}

void aim(view_kind kind, double yaw, double r[9])
{
    double c = cos(yaw), s = sin(yaw);
    const double street[9] = { c, s, 0, 0, 0, -1, -s, c, 0 }; /* right, down, ahead; ahead is north at yaw 0 */
    const double nadir[9] = { c, s, 0, s, -c, 0, 0, 0, -1 };
    memcpy(r, kind == NADIR ? nadir : street, 9 * sizeof *r);
}

void place_photo(city *c, int i, const double local[3])
{
    cn_frame frame;
    double at[3];
    cn_frame_init(&frame);
    frame.georeferenced = true;
    frame.latitude_deg = 10.0;
    frame.longitude_deg = 179.9999; /* the set crosses the antimeridian */
    frame.height_m = 50.0;
    assert_int_equal(cn_frame_to_geodetic(&frame, local, at), CN_OK);
    c->photos[i] = (cn_photo){ .name = c->scene.views[i].name,
                               .width = 100,
                               .height = 100,
                               .has_gps = true,
                               .latitude_deg = at[0],
                               .longitude_deg = at[1],
                               .has_altitude = true,
                               .altitude_m = at[2] };
}

void make_city(city *c, view_kind kind, bool line, bool turning)
{
    memset(c, 0, sizeof *c);
    double source_from_local[9], r[9];
    cn_quat_to_mat3(QUATERNION, source_from_local);
    c->scene.views = calloc(N, sizeof *c->scene.views);
    c->scene.n_views = N;
    for (int i = 0; i < N; i++) {
        cn_view *view = &c->scene.views[i];
        double *local = c->truth[i], centre[3], moved[3];
        local[0] = line ? 0.0 : 30.0 * uniform(100 + i);
        local[1] = 6.0 * i;
        local[2] = line ? 0.0 : 4.0 * uniform(200 + i);
        view->name = malloc(8);
        view->name[0] = (char)('a' + i);
        view->name[1] = '\0';
        view->photo = (uint32_t)i;
        aim(kind, kind == SIDEWAYS ? 1.5707963 : turning ? 0.3 * i : 0.0, r);
        double inverse[9];
        cn_mat3_transpose(source_from_local, inverse);
        cn_mat3_mul(r, inverse, view->rotation);
        cn_mat3_vec(source_from_local, local, centre);
        for (int k = 0; k < 3; k++)
            centre[k] = centre[k] / SCALE + SHIFT[k];
        cn_mat3_vec(view->rotation, centre, moved);
        for (int k = 0; k < 3; k++)
            view->translation[k] = -moved[k];
        place_photo(c, i, local);
    }
    const double z[3] = { 0, 0, 1 };
    cn_mat3_vec(source_from_local, z, c->up);
    c->index = (cn_photo_index){ .photos = c->photos, .n_photos = N, .n_gps = N };
}

void turn_view(cn_view *view, const double turn[9])
{
    double r[9], t[3];
    cn_mat3_mul(turn, view->rotation, r);
    cn_mat3_vec(turn, view->translation, t);
    memcpy(view->rotation, r, sizeof r);
    memcpy(view->translation, t, sizeof t);
}
