/* How much sky the photos show: the share of their area in cells that look like sky and are connected with the top
 * edge of the photo, above the horizon. A cell looks like sky when it holds no sparse point, is smooth, and is
 * brighter than the cells that hold points. All three are needed. Roofs and branches have points all along the sky's
 * edge, and walls are smooth too. */
#include "effect/display.h"
#include "effect/tracks.h"
#include "math/linalg.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum {
    SKY_X = CN_SKY_X,
    SKY_Y = CN_SKY_Y,
    CELLS = CN_SKY_CELLS,
    SIDE = 4, /* pixels that are read along a cell's side */
    PIXELS = SIDE * SIDE,
    MIN_TRACK = 3 /* views that a point needs; wrong matches across clouds have fewer */
};
/* Standard deviation within a cell, display-encoded. Found on castle, sceaux, lund, sacre-coeur (13 to 26 % sky),
 * herz-jesus (0.7 %) and brighton (none). */
#define SMOOTH 0.03
#define HORIZON 0.05 /* sine of the elevation */

typedef struct sky_photo {
    uint8_t point[CELLS];
} sky_photo;

typedef struct sky_cell {
    double mean, deviation; /* of display-encoded brightness; NaN: not readable */
} sky_cell;

static sky_cell read_cell(const cn_plan_input *input, uint32_t photo, cn_pixel_extent size, int x, int y)
{
    uint32_t photos[PIXELS];
    uint16_t px[PIXELS], py[PIXELS];
    float rgbw[4 * PIXELS], rgb[3];
    for (int i = 0; i < PIXELS; i++) {
        photos[i] = photo;
        px[i] = (uint16_t)((x + (i % SIDE + 0.5) / SIDE) * size.width / SKY_X);
        py[i] = (uint16_t)((y + (i / SIDE + 0.5) / SIDE) * size.height / SKY_Y);
    }
    if (cn_pixel_store_gather(input->pixels, PIXELS, photos, px, py, rgbw) != CN_OK) return (sky_cell){ NAN, NAN };
    double sum = 0, squares = 0;
    for (int i = 0; i < PIXELS; i++) {
        if (!(rgbw[4 * i + 3] > 0)) return (sky_cell){ NAN, NAN };
        cn_display(rgbw + 4 * i, rgb);
        const double grey = (double)(rgb[0] + rgb[1] + rgb[2]) / 3;
        sum += grey;
        squares += grey * grey;
    }
    const double mean = sum / PIXELS;
    return (sky_cell){ mean, sqrt(fmax(squares / PIXELS - mean * mean, 0)) };
}

static bool above_horizon(const cn_plan_input *input, const cn_view *view, int x, int y)
{
    const cn_camera *camera = &input->scene->cameras[view->camera];
    double in_camera[3], dir[3];
    if (cn_camera_unproject(camera, (x + 0.5) * camera->width / SKY_X, (y + 0.5) * camera->height / SKY_Y, in_camera) !=
        CN_OK)
        return false;
    cn_mat3_tvec(view->rotation, in_camera, dir);
    return dir[2] > HORIZON;
}

/* Counts the sky cells of one photo. In each column it goes from the top down to the first cell that is not sky. */
static uint32_t sky_cells(const cn_plan_input *input, const cn_view *view, const sky_photo *photo)
{
    if (view->photo >= cn_pixel_store_count(input->pixels)) return 0;
    const cn_pixel_extent size = cn_pixel_store_extent(input->pixels, view->photo);
    sky_cell cell[CELLS];
    double with_points[CELLS];
    size_t n = 0;
    for (int i = 0; i < CELLS; i++) {
        cell[i] = read_cell(input, view->photo, size, i % SKY_X, i / SKY_X);
        if (photo->point[i] && isfinite(cell[i].mean)) with_points[n++] = cell[i].mean;
    }
    if (!n) return 0;
    const double ground = cn_select(with_points, n, n / 2);
    uint32_t sky = 0;
    for (int x = 0; x < SKY_X; x++)
        for (int y = 0; y < SKY_Y; y++) {
            const sky_cell *c = &cell[y * SKY_X + x];
            if (photo->point[y * SKY_X + x] || !(c->deviation < SMOOTH && c->mean > ground)) break;
            if (!above_horizon(input, view, x, y)) break;
            sky++;
        }
    return sky;
}

/* Marks the cells with points of all views. NULL: out of memory. */
static sky_photo *find_points(const cn_scene *scene)
{
    sky_photo *photos = calloc(scene->n_views, sizeof *photos);
    for (uint32_t p = 0; photos && p < scene->n_points; p++)
        for (uint32_t i = 0; scene->points[p].n_observations >= MIN_TRACK && i < scene->points[p].n_observations; i++) {
            const cn_observation *o = &scene->observations[scene->points[p].first_observation + i];
            const cn_camera *camera = &scene->cameras[scene->views[o->view].camera];
            const int x = (int)((double)o->x_px * SKY_X / camera->width),
                      y = (int)((double)o->y_px * SKY_Y / camera->height);
            if (x >= 0 && y >= 0 && x < SKY_X && y < SKY_Y) photos[o->view].point[y * SKY_X + x] = 1;
        }
    return photos;
}

double cn_tracks_sky(const cn_plan_input *input, const cn_plan_tile *tile)
{
    const cn_scene *scene = input->scene;
    if (!input->pixels || scene->n_points < 50 || !tile->n_photos) return NAN;
    sky_photo *photos = find_points(scene);
    if (!photos) return NAN;
    uint64_t cells = 0;
    for (uint32_t p = 0; p < tile->n_photos; p++)
        cells += sky_cells(input, &scene->views[tile->photos[p]], &photos[tile->photos[p]]);
    free(photos);
    return (double)cells / ((double)tile->n_photos * CELLS);
}

bool cn_tracks_no_sky(const cn_scene *scene, const cn_plan_tile *tile, uint8_t *mark)
{
    memset(mark, 0, (size_t)tile->n_photos * CELLS);
    sky_photo *photos = find_points(scene);
    if (!photos) return false;
    for (uint32_t p = 0; p < tile->n_photos; p++)
        for (uint32_t x = 0; x < SKY_X; x++) {
            uint8_t below = 0;
            for (uint32_t y = 0; y < SKY_Y; y++) {
                const uint32_t cell = y * SKY_X + x;
                below |= photos[tile->photos[p]].point[cell];
                mark[(size_t)p * CELLS + cell] = below;
            }
        }
    free(photos);
    return true;
}
