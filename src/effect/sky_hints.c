/* Where a photo shows sky. The search begins in coarse cells: those that are connected with the top edge of the photo,
 * above the horizon, hold no sparse point, are smooth, and are brighter than the cells that hold points, or blue. All
 * of this is needed. Roofs and branches have points all along the sky's edge, walls are smooth too, and a clear sky may
 * be darker than a white wall. Of parts that differ in colour the largest is sky, and the others are walls that reach
 * the top edge, or clouds. From there the sky spreads in small steps of colour to its true edge, but not onto sparse
 * points and not far below them. Islands in it are clouds where nothing tells otherwise. At last the sky grows over a
 * narrow strip of its own colour, where that ends at an edge: sparse points lie all along roofs, and by their errors
 * beside them too. Such a strip is no wall, for that would go on.
 *
 * A photo that stands on its side or head is searched as it looks when it is held upright, and "top" and "below" are
 * meant so.
 *
 * A photo shows no sky at sparse points and below them, where no sky spread to. Nor does it show sky in what is much
 * darker than all of its sky, with no sky below. */
#include "effect/sky_hints.h"

#include "effect/display.h"
#include "effect/sky_even.h"
#include "effect/sky_points.h"
#include "effect/sky_turn.h"
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
    NEAR_POINT = 1,
    BORDER = 2,          /* coarse rows at the top that may be masked; more may be a mask of the sky */
    NEAR_ROW = 2,        /* coarse rows; from the zenith to the horizon a sky changes */
    MIN_SHOWN = N / 200, /* hints of sky that a photo needs to tell how dark its sky is */
    NO_POINT = Y
};
/* Display-encoded: standard deviation of brightness within a coarse cell, and the step of a channel from one hint to
 * the next. The first was found on castle, sceaux, lund, sacre-coeur (13 to 26 % sky), herz-jesus (0.7 %) and brighton
 * (none). */
#define SMOOTH 0.03f
#define BLUE 0.08f     /* blue above red */
#define CELL_STEP 0.1f /* from one coarse cell to the next */
#define HORIZON 0.05   /* sine of the elevation */
/* What is darker than the darkest hundredth of a photo's sky by this, and not blue, is no sky. Found on the made city,
 * lund, sacre-coeur and british_museum. */
#define DARKER 0.15f
/* The widest strip that the sky grows over, in hints. Found on reichstag (experiments.md, "Sky along roofs"); looked at
 * on sceaux, lund, sacre-coeur and castle. */
#define STRIP 12
/* How far a sparse point may be from the edge that it belongs to, in hints. Found on reichstag. */
#define OFF_EDGE 6

/* A cloudy sky is brighter than nearly all below it, a clear one is blue. A white ceiling is neither: windows and lit
 * walls are brighter. So sky that is not blue, while this part of the rest is brighter than its median, may be a
 * ceiling. By the mean of the tile's photos: two flats 0.33, 0.34; castle, sceaux, sacre-coeur, herz-jesus, two made
 * cities in many lights, british_museum and Family (Knapitsch et al. 2017) at most 0.08; lund 0.33, but deep blue.
 * Photos without colour cannot tell. */
#define BRIGHTER 0.2
#define COLOURLESS 0.01 /* mean difference of blue and red */
/* What a ceiling counts, of its area: a probe decides then, and where that is not clear there is no sky. */
#define CEILING 0.05

/* One photo, held upright; up: the side of the stored photo that is up. rgb: display-encoded; NaN: masked. point: 1 on
 * a sparse point and next to it. top: row of the uppermost sparse point of a coarse column. dark: what is darker may be
 * no sky. */
typedef struct sky_photo {
    cn_side up;
    float rgb[N][3];
    uint8_t point[N], sky[N], on[N], seen[N], leads_on[N], wall[N];
    double sky_brightness[N];
    uint32_t queue[N], from[N]; /* from: the hint of sky that a strip begins at */
    uint16_t top[COARSE_X];
    float dark;
} sky_photo;

static cn_status read_colours(const cn_plan_input *input, uint32_t photo, sky_photo *sky)
{
    const cn_pixel_extent extent = cn_pixel_store_extent(input->pixels, photo);
    const double size[2] = { extent.width, extent.height };
    uint32_t photos[X];
    uint16_t px[X], py[X];
    float rgbw[4 * X];
    for (int x = 0; x < X; x++)
        photos[x] = photo;
    for (int y = 0; y < Y; y++) {
        for (int x = 0; x < X; x++) {
            double at[2];
            cn_sky_turn_to_picture(sky->up, (const int[2]){ x, y }, (const int[2]){ X, Y }, size, at);
            px[x] = (uint16_t)at[0];
            py[x] = (uint16_t)at[1];
        }
        CN_TRY(cn_pixel_store_gather(input->pixels, X, photos, px, py, rgbw));
        for (int x = 0; x < X; x++) {
            float *rgb = sky->rgb[y * X + x];
            if (rgbw[4 * x + 3] > 0)
                cn_display(rgbw + 4 * x, rgb);
            else
                rgb[0] = rgb[1] = rgb[2] = NAN;
        }
    }
    return CN_OK;
}

static void mark_points(const cn_sky_points *points, const cn_scene *scene, uint32_t view, sky_photo *sky)
{
    memset(sky->point, 0, sizeof sky->point);
    for (int x = 0; x < COARSE_X; x++)
        sky->top[x] = NO_POINT;
    cn_sky_points_mark(points, scene, view, sky->on);
    for (int i = 0; i < N; i++) {
        if (!sky->on[i]) continue;
        const int at = cn_sky_turn_to_upright(sky->up, i), x = at % X, y = at / X;
        if (y < sky->top[x / SIDE]) sky->top[x / SIDE] = (uint16_t)y;
        for (int j = y - NEAR_POINT; j <= y + NEAR_POINT; j++)
            for (int k = x - NEAR_POINT; k <= x + NEAR_POINT; k++)
                if (j >= 0 && k >= 0 && j < Y && k < X) sky->point[j * X + k] = 1;
    }
}

/* What a coarse cell looks like; brightness NaN: more than half of it is masked. */
typedef struct sky_cell {
    float brightness, deviation, blue;
    bool point, above;
} sky_cell;

static bool alike(const sky_cell *a, const sky_cell *b)
{
    return fabsf(a->brightness - b->brightness) < CELL_STEP && fabsf(a->blue - b->blue) < CELL_STEP;
}

/* Sky like the cell before it in its column. A flat part of a wall right below the sky differs. */
static bool continues_sky(const sky_cell *cell, const sky_cell *before, float ground)
{
    return !cell->point && cell->above && cell->deviation < SMOOTH &&
           (cell->brightness > ground || cell->blue > BLUE) && alike(cell, before);
}

static float brightness(const float *rgb)
{
    return (rgb[0] + rgb[1] + rgb[2]) / 3;
}

static sky_cell look_at_cell(const sky_photo *sky, int cx, int cy)
{
    sky_cell cell = { 0 };
    double n = 0, sum = 0, squares = 0, blue = 0;
    for (int i = 0; i < SIDE * SIDE; i++) {
        const int at = (cy * SIDE + i / SIDE) * X + cx * SIDE + i % SIDE;
        const float *rgb = sky->rgb[at];
        const double grey = (double)brightness(rgb);
        cell.point |= sky->point[at];
        if (isnan(grey)) continue;
        n++;
        sum += grey;
        squares += grey * grey;
        blue += (double)(rgb[2] - rgb[0]);
    }
    const double mean = sum / n;
    cell.brightness = n < SIDE * SIDE / 2 ? NAN : (float)mean;
    cell.deviation = (float)sqrt(fmax(squares / n - mean * mean, 0));
    cell.blue = (float)(blue / n);
    return cell;
}

static bool above_horizon(const cn_plan_input *input, const cn_view *view, cn_side up, const int cell[2])
{
    const cn_camera *camera = &input->scene->cameras[view->camera];
    const double size[2] = { camera->width, camera->height };
    double px[2], in_camera[3], dir[3];
    cn_sky_turn_to_picture(up, cell, (const int[2]){ COARSE_X, COARSE_Y }, size, px);
    if (cn_camera_unproject(camera, px[0], px[1], in_camera) != CN_OK) return false;
    cn_mat3_tvec(view->rotation, in_camera, dir);
    return dir[2] > HORIZON;
}

/* Whether two places of the fine grid differ by less than that in each channel. */
static bool same_colour(const sky_photo *sky, uint32_t a, uint32_t b, float by)
{
    for (int c = 0; c < 3; c++)
        if (!(fabsf(sky->rgb[b][c] - sky->rgb[a][c]) < by)) return false;
    return true;
}

static bool is_above(const sky_cell *cells, uint32_t at)
{
    return cells[at / X / SIDE * COARSE_X + at % X / SIDE].above;
}

/* Sky spreads from cell `from` to cell `to` of the fine grid. */
static bool spreads(const sky_photo *sky, const sky_cell *cells, uint32_t from, uint32_t to)
{
    if (sky->sky[to] || sky->point[to] || !is_above(cells, to)) return false;
    return to / X <= (uint32_t)sky->top[to % X / SIDE] + SIDE && same_colour(sky, from, to, SMOOTH);
}

/* The neighbours of a place on a grid of that width and height; itself beyond an edge. */
static void find_neighbours(int at, int width, int height, int next[4])
{
    const int x = at % width, y = at / width;
    next[0] = x ? at - 1 : at;
    next[1] = x + 1 < width ? at + 1 : at;
    next[2] = y ? at - width : at;
    next[3] = y + 1 < height ? at + width : at;
}

static void spread(sky_photo *sky, const sky_cell *cells, uint32_t n)
{
    while (n) {
        const uint32_t at = sky->queue[--n];
        int next[4];
        find_neighbours((int)at, X, Y, next);
        for (int i = 0; i < 4; i++)
            if (spreads(sky, cells, at, (uint32_t)next[i])) {
                sky->sky[next[i]] = 1;
                sky->queue[n++] = (uint32_t)next[i];
            }
    }
}

/* In each column of coarse cells the sky goes from the top, or from below a masked border, down to the first cell that
 * does not look like sky. */
static void find_columns(const sky_cell *cells, float ground, bool *is_sky)
{
    for (int x = 0; x < COARSE_X; x++) {
        int i = x;
        while (i < BORDER * COARSE_X && isnan(cells[i].brightness))
            i += COARSE_X;
        const sky_cell *before = &cells[i];
        for (; i < COARSE && continues_sky(&cells[i], before, ground); i += COARSE_X) {
            is_sky[i] = true;
            before = &cells[i];
        }
    }
}

/* The cells of sky that are connected with `first` in small steps get the number `part`. Returns how many. */
static int number_part(const sky_cell *cells, const bool *is_sky, int first, int part, int *part_of)
{
    int queue[COARSE], queued = 0, n = 0;
    queue[queued++] = first;
    part_of[first] = part;
    for (; n < queued; n++) {
        int next[4];
        find_neighbours(queue[n], COARSE_X, COARSE_Y, next);
        for (int i = 0; i < 4; i++)
            if (is_sky[next[i]] && part_of[next[i]] < 0 && alike(&cells[queue[n]], &cells[next[i]])) {
                part_of[next[i]] = part;
                queue[queued++] = next[i];
            }
    }
    return n;
}

/* Of parts of sky that are not connected, keeps the largest one, and those that look like it somewhere at the same
 * height: a tower may divide the sky. */
static void keep_largest(const sky_cell *cells, bool *is_sky)
{
    int part_of[COARSE], n_parts = 0, largest = 0, most = 0;
    bool keep[COARSE] = { 0 };
    for (int i = 0; i < COARSE; i++)
        part_of[i] = -1;
    for (int i = 0; i < COARSE; i++) {
        if (!is_sky[i] || part_of[i] >= 0) continue;
        const int n = number_part(cells, is_sky, i, n_parts, part_of);
        if (n > most) {
            most = n;
            largest = n_parts;
        }
        n_parts++;
    }
    if (n_parts < 2) return;
    keep[largest] = true;
    for (int i = 0; i < COARSE; i++)
        for (int j = 0; j < COARSE && part_of[i] == largest; j++)
            if (part_of[j] >= 0 && abs(j / COARSE_X - i / COARSE_X) <= NEAR_ROW && alike(&cells[i], &cells[j]))
                keep[part_of[j]] = true;
    for (int i = 0; i < COARSE; i++)
        is_sky[i] = is_sky[i] && keep[part_of[i]];
}

static void find_dark(sky_photo *sky)
{
    size_t n = 0;
    for (uint32_t i = 0; i < N; i++)
        if (sky->sky[i] && !isnan(brightness(sky->rgb[i]))) sky->sky_brightness[n++] = (double)brightness(sky->rgb[i]);
    sky->dark = n < MIN_SHOWN ? -INFINITY : (float)cn_select(sky->sky_brightness, n, n / 100) - DARKER;
}

static bool is_dark(const sky_photo *sky, const float *rgb)
{
    return brightness(rgb) < sky->dark && rgb[2] - rgb[0] < BLUE;
}

static bool cannot_be_sky(const sky_photo *sky, const sky_cell *cells, uint32_t at)
{
    return sky->point[at] || at / X >= sky->top[at % X / SIDE] || !is_above(cells, at) || is_dark(sky, sky->rgb[at]);
}

/* Clouds are not smooth. What is surrounded by sky, and by the photo's edge, is as bright or as blue as sky may be, and
 * has nothing dark (lamps), is sky too. */
static void fill_islands(sky_photo *sky, const sky_cell *cells, float ground)
{
    memset(sky->seen, 0, sizeof sky->seen);
    for (uint32_t first = 0; first < N; first++) {
        if (sky->sky[first] || sky->seen[first]) continue;
        uint32_t queued = 0, n = 0;
        bool island = true;
        double sum = 0, blue = 0;
        sky->queue[queued++] = first;
        sky->seen[first] = 1;
        for (; n < queued; n++) {
            const uint32_t at = sky->queue[n];
            int next[4];
            find_neighbours((int)at, X, Y, next);
            island = island && !cannot_be_sky(sky, cells, at);
            sum += (double)brightness(sky->rgb[at]);
            blue += (double)(sky->rgb[at][2] - sky->rgb[at][0]);
            for (int i = 0; i < 4; i++)
                if (!sky->sky[next[i]] && !sky->seen[next[i]]) {
                    sky->seen[next[i]] = 1;
                    sky->queue[queued++] = (uint32_t)next[i];
                }
        }
        if (!island || !(sum > n * (double)ground || blue > n * (double)BLUE)) continue;
        for (uint32_t i = 0; i < n; i++)
            sky->sky[sky->queue[i]] = 1;
    }
}

/* A point with one colour all round belongs to no edge: it tells of matter as bright as the sky. No strip goes there.
 */
static void find_walls(sky_photo *sky)
{
    memset(sky->wall, 0, sizeof sky->wall);
    for (int i = 0; i < N; i++) {
        const int left = i % X > OFF_EDGE ? i % X - OFF_EDGE : 0,
                  right = i % X + OFF_EDGE < X ? i % X + OFF_EDGE : X - 1,
                  top = i / X > OFF_EDGE ? i / X - OFF_EDGE : 0,
                  bottom = i / X + OFF_EDGE < Y ? i / X + OFF_EDGE : Y - 1;
        bool one_colour = sky->on[i];
        for (int y = top; one_colour && y <= bottom; y++)
            for (int x = left; one_colour && x <= right; x++)
                one_colour = same_colour(sky, (uint32_t)i, (uint32_t)(y * X + x), 2 * SMOOTH);
        for (int y = top; one_colour && y <= bottom; y++)
            memset(sky->wall + y * X + left, 1, (size_t)(right - left + 1));
    }
}

/* A strip goes on from `at` to `to`: a small step of colour, and still the colour of the sky that it begins at. */
static bool strip_goes_on(const sky_photo *sky, const sky_cell *cells, uint32_t at, uint32_t to)
{
    return !sky->sky[to] && !sky->wall[to] && is_above(cells, to) && same_colour(sky, at, to, SMOOTH) &&
           same_colour(sky, sky->from[at], to, 2 * SMOOTH);
}

/* sky->seen: how many steps a place is from the sky, plus 1; BEYOND: beyond the widest strip; 0 where none reaches.
 * What goes on beyond is a wall, and with it what lies between it and the sky: leads_on. queued: places in the queue.
 */
enum { BEYOND = STRIP + 2 };
static void find_what_leads_on(sky_photo *sky, uint32_t queued)
{
    uint32_t back = 0;
    memset(sky->leads_on, 0, sizeof sky->leads_on);
    for (uint32_t n = 0; n < queued; n++)
        if (sky->seen[sky->queue[n]] == BEYOND) {
            sky->leads_on[sky->queue[n]] = 1;
            sky->queue[back++] = sky->queue[n];
        }
    for (uint32_t n = 0; n < back; n++) {
        const uint32_t at = sky->queue[n];
        int next[4];
        find_neighbours((int)at, X, Y, next);
        for (int i = 0; i < 4 && sky->leads_on[at] <= 2 * STRIP; i++)
            if (!sky->leads_on[next[i]] && sky->seen[next[i]] > 1 && sky->seen[next[i]] <= sky->seen[at]) {
                sky->leads_on[next[i]] = (uint8_t)(sky->leads_on[at] + 1);
                sky->queue[back++] = (uint32_t)next[i];
            }
    }
}

static void grow_over_strips(sky_photo *sky, const sky_cell *cells)
{
    uint32_t queued = 0;
    find_walls(sky);
    memset(sky->seen, 0, sizeof sky->seen);
    for (uint32_t i = 0; i < N; i++)
        if (sky->sky[i]) {
            sky->seen[i] = 1;
            sky->from[i] = sky->queue[queued++] = i;
        }
    for (uint32_t n = 0; n < queued; n++) {
        const uint32_t at = sky->queue[n];
        int next[4];
        find_neighbours((int)at, X, Y, next);
        for (int i = 0; i < 4 && sky->seen[at] < BEYOND; i++)
            if (!sky->seen[next[i]] && strip_goes_on(sky, cells, at, (uint32_t)next[i])) {
                sky->seen[next[i]] = (uint8_t)(sky->seen[at] + 1);
                sky->from[next[i]] = sky->from[at];
                sky->queue[queued++] = (uint32_t)next[i];
            }
    }
    find_what_leads_on(sky, queued);
    for (uint32_t i = 0; i < N; i++)
        sky->sky[i] |= sky->seen[i] > 1 && !sky->leads_on[i];
}

/* Finds the sky of a photo. False: the photo tells nothing. */
static bool find_sky(const cn_plan_input *input, uint32_t view_index, const cn_sky_points *points, sky_photo *sky)
{
    const cn_view *view = &input->scene->views[view_index];
    if (view->photo >= cn_pixel_store_count(input->pixels)) return false;
    if (!cn_sky_points_any(points, view_index)) return false;
    sky->up = cn_view_side_up(view);
    mark_points(points, input->scene, view_index, sky);
    memset(sky->sky, 0, sizeof sky->sky);
    sky->dark = -INFINITY;
    if (read_colours(input, view->photo, sky) != CN_OK) return true;
    sky_cell cells[COARSE];
    bool is_sky[COARSE] = { 0 };
    double with_points[COARSE];
    size_t n = 0;
    for (int i = 0; i < COARSE; i++) {
        const int cell[2] = { i % COARSE_X, i / COARSE_X };
        cells[i] = look_at_cell(sky, cell[0], cell[1]);
        cells[i].above = above_horizon(input, view, sky->up, cell);
        if (cells[i].point && isfinite(cells[i].brightness)) with_points[n++] = (double)cells[i].brightness;
    }
    if (!n) return true;
    const float ground = (float)cn_select(with_points, n, n / 2);
    find_columns(cells, ground, is_sky);
    keep_largest(cells, is_sky);
    uint32_t seeds = 0;
    for (uint32_t i = 0; i < N; i++)
        if (is_sky[i / X / SIDE * COARSE_X + i % X / SIDE]) {
            sky->sky[i] = 1;
            sky->queue[seeds++] = i;
        }
    spread(sky, cells, seeds);
    find_dark(sky);
    fill_islands(sky, cells, ground);
    grow_over_strips(sky, cells);
    return true;
}

/* At the sky's edge a pixel may be a mixture: nothing is known there. sky_below: of dark clouds. */
static cn_sky_hint hint_at(const sky_photo *sky, uint32_t at, bool sky_below)
{
    const uint32_t x = at % X, y = at / X;
    const float *rgb = sky->rgb[at];
    if (!sky->sky[at])
        return y >= sky->top[x / SIDE] || (is_dark(sky, rgb) && !sky_below) ? CN_SKY_NONE : CN_SKY_UNKNOWN;
    const bool inside = (!x || sky->sky[at - 1]) && (x + 1 == X || sky->sky[at + 1]) && (!y || sky->sky[at - X]) &&
                        (y + 1 == Y || sky->sky[at + X]);
    return inside ? CN_SKY_SHOWN : CN_SKY_UNKNOWN;
}

/* hint: in the stored picture. */
static void give_hints(const sky_photo *sky, uint8_t *hint)
{
    uint8_t upright[N];
    for (uint32_t x = 0; x < X; x++) {
        bool sky_below = false;
        for (uint32_t at = N - X + x; at < N; at -= X) {
            upright[at] = (uint8_t)hint_at(sky, at, sky_below);
            sky_below |= sky->sky[at];
        }
    }
    for (int i = 0; i < N; i++)
        hint[i] = upright[cn_sky_turn_to_upright(sky->up, i)];
}

bool cn_sky_hints_find(const cn_plan_input *input, const cn_plan_tile *tile, uint8_t *hint)
{
    cn_sky_points points = { 0 };
    memset(hint, CN_SKY_UNKNOWN, (size_t)tile->n_photos * N);
    sky_photo *sky = malloc(sizeof *sky);
    const bool room = sky && cn_sky_points_find(input->scene, tile, &points);
    for (uint32_t p = 0; room && p < tile->n_photos; p++)
        if (find_sky(input, tile->photos[p], &points, sky)) {
            give_hints(sky, hint + (size_t)p * N);
            cn_sky_even_keep(input->pixels, input->scene->views[tile->photos[p]].photo, hint + (size_t)p * N);
        }
    cn_sky_points_deinit(&points);
    free(sky);
    return room;
}

/* What the photos of a tile show as sky, and beside it. */
typedef struct sky_sums {
    double all, sky; /* hints */
    double colour;   /* over all hints: difference of blue and red */
    double blue;     /* over the hints of sky: blue less red */
    double brighter; /* over the hints of sky: the part of its photo's rest that is brighter */
} sky_sums;

static void add_photo(sky_photo *sky, sky_sums *sums)
{
    size_t n = 0, rest = 0, brighter = 0;
    sums->all += N;
    for (uint32_t i = 0; i < N; i++) {
        const float *rgb = sky->rgb[i];
        sums->sky += sky->sky[i];
        if (isnan(brightness(rgb))) continue;
        const double blue = (double)(rgb[2] - rgb[0]);
        sums->colour += fabs(blue);
        if (!sky->sky[i]) continue;
        sums->blue += blue;
        sky->sky_brightness[n++] = (double)brightness(rgb);
    }
    if (!n) return;
    const double median = cn_select(sky->sky_brightness, n, n / 2);
    for (uint32_t i = 0; i < N; i++) {
        if (sky->sky[i] || isnan(brightness(sky->rgb[i]))) continue;
        rest++;
        brighter += (double)brightness(sky->rgb[i]) > median;
    }
    if (rest) sums->brighter += (double)n * (double)brighter / (double)rest;
}

static bool may_be_ceiling(const sky_sums *sums)
{
    return sums->blue < sums->sky * (double)BLUE && sums->brighter > sums->sky * BRIGHTER &&
           sums->colour > sums->all * COLOURLESS;
}

double cn_sky_hints_share(const cn_plan_input *input, const cn_plan_tile *tile)
{
    cn_sky_points points = { 0 };
    sky_sums sums = { 0 };
    if (!input->pixels || input->scene->n_points < 50 || !tile->n_photos) return NAN;
    sky_photo *sky = malloc(sizeof *sky);
    const bool room = sky && cn_sky_points_find(input->scene, tile, &points);
    for (uint32_t p = 0; room && p < tile->n_photos; p++)
        if (find_sky(input, tile->photos[p], &points, sky)) add_photo(sky, &sums);
    cn_sky_points_deinit(&points);
    free(sky);
    if (!(sums.all > 0)) return NAN;
    return (may_be_ceiling(&sums) ? CEILING : 1) * sums.sky / sums.all;
}
