/* Where a photo shows sky. The search begins in coarse cells: those that are connected with the top edge of the photo,
 * above the horizon, hold no sparse point, are smooth, and are brighter than the cells that hold points, or blue. All
 * of this is needed. Roofs and branches have points all along the sky's edge, walls are smooth too, and a clear sky may
 * be darker than a white wall. From there the sky spreads in small steps of colour to its true edge, but not onto
 * sparse points and not far below them.
 *
 * A photo shows no sky at sparse points and below them, where no sky spread to. */
#include "effect/sky_hints.h"

#include "effect/display.h"
#include "math/linalg.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum {
    X = CN_SKY_HINT_X,
    Y = CN_SKY_HINT_Y,
    N = CN_SKY_HINTS,
    SIDE = 8, /* hints along a coarse cell's side */
    COARSE_X = X / SIDE,
    COARSE_Y = Y / SIDE,
    COARSE = COARSE_X * COARSE_Y,
    MIN_TRACK = 3, /* views that a point needs; wrong matches across clouds have fewer */
    NEAR_POINT = 1,
    NO_POINT = Y
};
/* Display-encoded: standard deviation of brightness within a coarse cell, and the step of a channel from one hint to
 * the next. The first was found on castle, sceaux, lund, sacre-coeur (13 to 26 % sky), herz-jesus (0.7 %) and brighton
 * (none). */
#define SMOOTH 0.03f
#define BLUE 0.08f     /* blue above red */
#define CELL_STEP 0.1f /* from one coarse cell to the next */
#define HORIZON 0.05   /* sine of the elevation */

/* One photo. rgb: display-encoded; NaN: masked. point: 1 on a sparse point and next to it. top: row of the uppermost
 * sparse point of a coarse column. */
typedef struct sky_photo {
    float rgb[N][3];
    uint8_t point[N], sky[N];
    uint32_t queue[N];
    uint16_t top[COARSE_X];
} sky_photo;

/* Sparse points of all views, by view: first[view] to first[view + 1]. */
typedef struct view_points {
    uint32_t *first;
    uint16_t (*at)[2]; /* hint's column and row */
} view_points;

static void view_points_deinit(view_points *points)
{
    free(points->first);
    free(points->at);
}

static bool find_points(const cn_scene *scene, view_points *points)
{
    *points = (view_points){ calloc(scene->n_views + 2u, sizeof *points->first),
                             malloc(sizeof *points->at * (scene->n_observations + 1u)) };
    for (int pass = 0; pass < 2 && points->first && points->at; pass++) {
        for (uint32_t p = 0; p < scene->n_points; p++) {
            const cn_point *point = &scene->points[p];
            for (uint32_t i = 0; point->n_observations >= MIN_TRACK && i < point->n_observations; i++) {
                const cn_observation *o = &scene->observations[point->first_observation + i];
                const cn_camera *camera = &scene->cameras[scene->views[o->view].camera];
                const double x = (double)o->x_px * X / camera->width, y = (double)o->y_px * Y / camera->height;
                if (!(x >= 0 && y >= 0 && x < X && y < Y)) continue;
                if (pass == 0) points->first[o->view + 2]++;
                if (pass == 1)
                    memcpy(points->at[points->first[o->view + 1]++], (uint16_t[2]){ (uint16_t)x, (uint16_t)y },
                           sizeof *points->at);
            }
        }
        for (uint32_t v = 0; pass == 0 && v < scene->n_views; v++)
            points->first[v + 2] += points->first[v + 1];
    }
    return points->first && points->at;
}

static cn_status read_colours(const cn_plan_input *input, uint32_t photo, sky_photo *sky)
{
    const cn_pixel_extent size = cn_pixel_store_extent(input->pixels, photo);
    uint32_t photos[X];
    uint16_t px[X], py[X];
    float rgbw[4 * X];
    for (uint32_t x = 0; x < X; x++) {
        photos[x] = photo;
        px[x] = (uint16_t)((2 * x + 1) * size.width / (2 * X));
    }
    for (uint32_t y = 0; y < Y; y++) {
        for (uint32_t x = 0; x < X; x++)
            py[x] = (uint16_t)((2 * y + 1) * size.height / (2 * Y));
        CN_TRY(cn_pixel_store_gather(input->pixels, X, photos, px, py, rgbw));
        for (uint32_t x = 0; x < X; x++) {
            float *rgb = sky->rgb[y * X + x];
            if (rgbw[4 * x + 3] > 0)
                cn_display(rgbw + 4 * x, rgb);
            else
                rgb[0] = rgb[1] = rgb[2] = NAN;
        }
    }
    return CN_OK;
}

static void mark_points(const view_points *points, uint32_t view, sky_photo *sky)
{
    memset(sky->point, 0, sizeof sky->point);
    for (int x = 0; x < COARSE_X; x++)
        sky->top[x] = NO_POINT;
    for (uint32_t i = points->first[view]; i < points->first[view + 1]; i++) {
        const int x = points->at[i][0], y = points->at[i][1];
        if (y < sky->top[x / SIDE]) sky->top[x / SIDE] = (uint16_t)y;
        for (int j = y - NEAR_POINT; j <= y + NEAR_POINT; j++)
            for (int k = x - NEAR_POINT; k <= x + NEAR_POINT; k++)
                if (j >= 0 && k >= 0 && j < Y && k < X) sky->point[j * X + k] = 1;
    }
}

/* What a coarse cell looks like; brightness NaN: masked. */
typedef struct sky_cell {
    float brightness, deviation, blue;
    bool point, above;
} sky_cell;

/* Sky like the cell before it in its column. A flat part of a wall right below the sky differs. */
static bool continues_sky(const sky_cell *cell, const sky_cell *before, float ground)
{
    return !cell->point && cell->above && cell->deviation < SMOOTH &&
           (cell->brightness > ground || cell->blue > BLUE) &&
           fabsf(cell->brightness - before->brightness) < CELL_STEP && fabsf(cell->blue - before->blue) < CELL_STEP;
}

static sky_cell look_at_cell(const sky_photo *sky, int cx, int cy)
{
    sky_cell cell = { 0 };
    double sum = 0, squares = 0, blue = 0;
    for (int i = 0; i < SIDE * SIDE; i++) {
        const int at = (cy * SIDE + i / SIDE) * X + cx * SIDE + i % SIDE;
        const float *rgb = sky->rgb[at];
        const double grey = (double)(rgb[0] + rgb[1] + rgb[2]) / 3;
        sum += grey;
        squares += grey * grey;
        blue += (double)(rgb[2] - rgb[0]);
        cell.point |= sky->point[at];
    }
    const double n = SIDE * SIDE, mean = sum / n;
    cell.brightness = (float)mean;
    cell.deviation = (float)sqrt(fmax(squares / n - mean * mean, 0));
    cell.blue = (float)(blue / n);
    return cell;
}

static bool above_horizon(const cn_plan_input *input, const cn_view *view, int cx, int cy)
{
    const cn_camera *camera = &input->scene->cameras[view->camera];
    double in_camera[3], dir[3];
    if (cn_camera_unproject(camera, (cx + 0.5) * camera->width / COARSE_X, (cy + 0.5) * camera->height / COARSE_Y,
                            in_camera) != CN_OK)
        return false;
    cn_mat3_tvec(view->rotation, in_camera, dir);
    return dir[2] > HORIZON;
}

/* Sky spreads from cell `from` to cell `to` of the fine grid. */
static bool spreads(const sky_photo *sky, const sky_cell *cells, uint32_t from, uint32_t to)
{
    const uint32_t x = to % X, y = to / X;
    if (sky->sky[to] || sky->point[to] || !cells[y / SIDE * COARSE_X + x / SIDE].above) return false;
    if (y > (uint32_t)sky->top[x / SIDE] + SIDE) return false;
    for (int c = 0; c < 3; c++)
        if (!(fabsf(sky->rgb[to][c] - sky->rgb[from][c]) < SMOOTH)) return false;
    return true;
}

static void spread(sky_photo *sky, const sky_cell *cells, uint32_t n)
{
    while (n) {
        const uint32_t at = sky->queue[--n], x = at % X, y = at / X;
        const uint32_t next[4] = { x ? at - 1 : at, x + 1 < X ? at + 1 : at, y ? at - X : at, y + 1 < Y ? at + X : at };
        for (int i = 0; i < 4; i++)
            if (spreads(sky, cells, at, next[i])) {
                sky->sky[next[i]] = 1;
                sky->queue[n++] = next[i];
            }
    }
}

/* Finds sky->sky of a photo. In each column of coarse cells the sky goes from the top down to the first cell that does
 * not look like sky. False: the photo tells nothing. */
static bool find_sky(const cn_plan_input *input, uint32_t view_index, const view_points *points, sky_photo *sky)
{
    const cn_view *view = &input->scene->views[view_index];
    if (view->photo >= cn_pixel_store_count(input->pixels)) return false;
    if (points->first[view_index] == points->first[view_index + 1]) return false;
    mark_points(points, view_index, sky);
    memset(sky->sky, 0, sizeof sky->sky);
    if (read_colours(input, view->photo, sky) != CN_OK) return true;
    sky_cell cells[COARSE];
    double with_points[COARSE];
    size_t n = 0;
    for (int i = 0; i < COARSE; i++) {
        cells[i] = look_at_cell(sky, i % COARSE_X, i / COARSE_X);
        cells[i].above = above_horizon(input, view, i % COARSE_X, i / COARSE_X);
        if (cells[i].point && isfinite(cells[i].brightness)) with_points[n++] = (double)cells[i].brightness;
    }
    if (!n) return true;
    const float ground = (float)cn_select(with_points, n, n / 2);
    uint32_t seeds = 0;
    for (uint32_t cx = 0; cx < COARSE_X; cx++)
        for (uint32_t cy = 0; cy < COARSE_Y; cy++) {
            const uint32_t cell = cy * COARSE_X + cx;
            if (!continues_sky(&cells[cell], &cells[cy ? cell - COARSE_X : cell], ground)) break;
            for (uint32_t i = 0; i < SIDE * SIDE; i++) {
                const uint32_t at = (cy * SIDE + i / SIDE) * X + cx * SIDE + i % SIDE;
                sky->sky[at] = 1;
                sky->queue[seeds++] = at;
            }
        }
    spread(sky, cells, seeds);
    return true;
}

/* At the sky's edge a pixel may be a mixture: nothing is known there. */
static cn_sky_hint hint_at(const sky_photo *sky, uint32_t at)
{
    const uint32_t x = at % X, y = at / X;
    if (!sky->sky[at]) return y >= sky->top[x / SIDE] ? CN_SKY_NONE : CN_SKY_UNKNOWN;
    const bool inside = (!x || sky->sky[at - 1]) && (x + 1 == X || sky->sky[at + 1]) && (!y || sky->sky[at - X]) &&
                        (y + 1 == Y || sky->sky[at + X]);
    return inside ? CN_SKY_SHOWN : CN_SKY_UNKNOWN;
}

bool cn_sky_hints_find(const cn_plan_input *input, const cn_plan_tile *tile, uint8_t *hint)
{
    view_points points;
    memset(hint, CN_SKY_UNKNOWN, (size_t)tile->n_photos * N);
    sky_photo *sky = malloc(sizeof *sky);
    const bool room = sky && find_points(input->scene, &points);
    for (uint32_t p = 0; room && p < tile->n_photos; p++) {
        if (!find_sky(input, tile->photos[p], &points, sky)) continue;
        for (uint32_t i = 0; i < N; i++)
            hint[(size_t)p * N + i] = (uint8_t)hint_at(sky, i);
    }
    if (sky) view_points_deinit(&points);
    free(sky);
    return room;
}

double cn_sky_hints_share(const cn_plan_input *input, const cn_plan_tile *tile)
{
    view_points points = { 0 };
    if (!input->pixels || input->scene->n_points < 50 || !tile->n_photos) return NAN;
    sky_photo *sky = malloc(sizeof *sky);
    const bool room = sky && find_points(input->scene, &points);
    uint64_t cells = 0;
    for (uint32_t p = 0; room && p < tile->n_photos; p++)
        if (find_sky(input, tile->photos[p], &points, sky))
            for (uint32_t i = 0; i < N; i++)
                cells += sky->sky[i];
    if (sky) view_points_deinit(&points);
    free(sky);
    return room ? (double)cells / ((double)tile->n_photos * N) : NAN;
}
