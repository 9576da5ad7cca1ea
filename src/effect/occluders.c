/* Where a photo tracks none of the sparse points that others photos see there, and shows other colours than theirs,
 * something stands before them. If no other photo sees it, its distance is not known, and training puts it up anywhere:
 * leaves at the edge of two photos of sceaux floated before its facade. Such places are left out, like a mask:
 * tests/bench/experiments.md, "What one photo alone shows before others".
 *
 * Many photos with such places are not those of single things. A smooth statue, which has no sparse points, hides the
 * wall behind it in each photo; people walk through all photos, and are left to transients (src/train/train.c). */
#include "effect/occluders.h"

#include "effect/tracks.h"
#include "math/linalg.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { X = CN_HIDDEN_COLUMNS, Y = CN_HIDDEN_ROWS, CELLS = X * Y };
_Static_assert((int)CELLS == (int)CN_TRACK_CELLS && (int)X == (int)CN_TRACK_COLUMNS,
               "what a photo tracks is counted in the cells that are hidden");

/* Found on sceaux, and looked at on 26 more sets. It finds leaves on sceaux, a car and a tree on herz-jesus, trees, a
 * banner and the sun in the lens on reichstag, and on kitchen parts of two photos, one of which has a wrong pose; on
 * castle, brighton, lund and sacre-coeur it finds nothing. Without MOST_TOUCHED it would take a statue, and without a
 * limit for each photo the houses of a made city by night. */
/* MOST_PHOTOS: each takes half a megabyte here, and many others outvote it in training. Not measured apart. */
enum { MOST_PHOTOS = 400, SAMPLED_POINTS = 6000, MIN_POINTS = 200 };
enum { FEWEST_CHANGED = 4 }; /* points in a cell and the eight about it */
enum { FEWEST_CELLS = 6, FEWEST_TOGETHER = 4 };
#define TRACKED 0.25       /* of the changed points; from there on the place is seen well */
#define CHANGED 0.5        /* of the points that should be seen */
#define MOST_TOUCHED 0.25  /* of the photos: those with a single such cell count, too */
#define LARGEST 0.3        /* of a photo: more is what the photo is of, such as a roof before a street */
#define SAME_SIDE 0.9397   /* cosine of 20 degrees to a photo that tracks the point */
#define NEARER 0.75        /* the distance from the point over that photo's, at least ... */
#define FARTHER 1.3        /* ... and at most */
#define LIKE_STOPS 1.5     /* cells of the same thing: their mean colours ... */
#define LIKE_CONTRAST 2.5  /* ... and the ratio of their contrasts */
#define LEAST_CONTRAST 0.1 /* stops */
enum { ACROSS = CN_TRACKS_COARSE };
#define DARKEST 0.003f

/* A photo scaled down to ACROSS pixels of width: log2 of its linear light, NaN where it is masked. */
typedef struct small_photo {
    uint32_t width, height;
    float (*colour)[3];
} small_photo;

typedef struct seen_point {
    uint32_t point, first, n; /* of the scene; its observations by training photos */
    float mean[3];            /* colour, less the photos' gains */
} seen_point;
typedef struct sighting {
    uint32_t photo; /* row in tile->photos */
    float colour[3];
} sighting;

typedef struct finder {
    const cn_plan_input *input;
    const cn_plan_tile *tile;
    uint32_t *row;
    small_photo *small;
    seen_point *points;
    sighting *sightings;
    uint32_t n_points, n_sightings;
    float (*gain)[3];     /* [photos] stops */
    float (*near)[CELLS]; /* [photos] distance of the nearest point that the photo tracks, m */
    float (*tracked)[CELLS], (*changed)[CELLS], (*usual)[CELLS]; /* [photos] points that the photo tracks; that it does
                                                 not track, where it shows another colour; and where it shows theirs */
    float *limit;                                                /* [photos] stops */
    uint32_t (*found)[Y];                                        /* [photos], of the result */
} finder;

static cn_status shrink(const cn_pixel_store *store, uint32_t photo, small_photo *s)
{
    const cn_pixel_extent size = cn_pixel_store_extent(store, photo);
    s->width = size.width < ACROSS ? size.width : ACROSS;
    s->height = (uint32_t)fmax(1, round((double)size.height * s->width / size.width));
    float *rgbw = malloc((size_t)size.width * size.height * 4 * sizeof *rgbw);
    s->colour = malloc((size_t)s->width * s->height * sizeof *s->colour);
    cn_status status = rgbw && s->colour ? cn_pixel_store_read(store, photo, rgbw)
                                         : cn_fail(CN_ERR_NOMEM, "out of memory looking for occluders");
    for (uint32_t y = 0; status == CN_OK && y < s->height; y++)
        for (uint32_t x = 0; x < s->width; x++) {
            const size_t x0 = (size_t)x * size.width / s->width, x1 = (x + (size_t)1) * size.width / s->width,
                         y0 = (size_t)y * size.height / s->height, y1 = (y + (size_t)1) * size.height / s->height;
            float sum[3] = { 0 }, n = 0;
            bool whole = true;
            for (size_t v = y0; v < y1; v++)
                for (size_t u = x0; u < x1; u++, n++) {
                    const float *p = rgbw + 4 * (v * size.width + u);
                    whole = whole && p[3] >= 0.5f;
                    for (size_t c = 0; c < 3; c++)
                        sum[c] += p[c];
                }
            for (size_t c = 0; c < 3; c++)
                s->colour[y * s->width + x][c] = whole && n > 0 ? log2f(fmaxf(sum[c] / n, DARKEST)) : NAN;
        }
    free(rgbw);
    return status;
}

/* The colour of a photo about a pixel of its view's camera, dx and dy of its small pixels aside. NaN: masked. */
static const float *colour_at(const finder *f, uint32_t photo, const double xy[2], int dx, int dy)
{
    const small_photo *s = &f->small[photo];
    const cn_camera *camera = &f->input->scene->cameras[f->input->scene->views[f->tile->photos[photo]].camera];
    const double x = floor(xy[0] * s->width / camera->width) + dx, y = floor(xy[1] * s->height / camera->height) + dy;
    const size_t u = (size_t)fmin(fmax(x, 0), s->width - 1.0), v = (size_t)fmin(fmax(y, 0), s->height - 1.0);
    return s->colour[v * s->width + u];
}

/* What the photos track, by cells. */
static void note_tracked(finder *f)
{
    const cn_scene *scene = f->input->scene;
    for (uint32_t p = 0; p < scene->n_points; p++)
        for (uint32_t i = 0; i < scene->points[p].n_observations; i++) {
            const cn_observation *o = &scene->observations[(size_t)scene->points[p].first_observation + i];
            const uint32_t photo = f->row[o->view];
            if (photo == UINT32_MAX) continue;
            const cn_view *view = &scene->views[o->view];
            const int cell = cn_track_cell(&scene->cameras[view->camera], o->x_px, o->y_px);
            if (cell < 0) continue;
            double centre[3];
            cn_view_centre(view, centre);
            f->tracked[photo][cell]++;
            f->near[photo][cell] = fminf(f->near[photo][cell], (float)cn_distance3(centre, scene->points[p].xyz));
        }
}

static uint32_t count_sightings(const finder *f, uint32_t point)
{
    const cn_point *p = &f->input->scene->points[point];
    uint32_t n = 0;
    for (uint32_t i = 0; i < p->n_observations; i++)
        n += f->row[f->input->scene->observations[(size_t)p->first_observation + i].view] != UINT32_MAX;
    return n;
}

/* Points that two training photos see, evenly thinned, with the colours that these photos show there. */
static cn_status gather(finder *f)
{
    const cn_scene *scene = f->input->scene;
    uint32_t n = 0, at = 0;
    for (uint32_t p = 0; p < scene->n_points; p++)
        n += count_sightings(f, p) >= 2;
    const uint32_t step = n / SAMPLED_POINTS ? n / SAMPLED_POINTS : 1;
    f->points = malloc((n / step + (size_t)1) * sizeof *f->points);
    f->sightings = malloc((scene->n_observations + (size_t)1) * sizeof *f->sightings);
    if (!f->points || !f->sightings) return cn_fail(CN_ERR_NOMEM, "out of memory looking for occluders");
    for (uint32_t p = 0; p < scene->n_points; p++) {
        if (count_sightings(f, p) < 2 || at++ % step) continue;
        seen_point *point = &f->points[f->n_points++];
        *point = (seen_point){ .point = p, .first = f->n_sightings };
        for (uint32_t i = 0; i < scene->points[p].n_observations; i++) {
            const cn_observation *o = &scene->observations[(size_t)scene->points[p].first_observation + i];
            const uint32_t photo = f->row[o->view];
            if (photo == UINT32_MAX) continue;
            const float *colour = colour_at(f, photo, (const double[2]){ o->x_px, o->y_px }, 0, 0);
            if (isnan(colour[0])) continue;
            sighting *s = &f->sightings[f->n_sightings++];
            s->photo = photo;
            memcpy(s->colour, colour, sizeof s->colour);
        }
        point->n = f->n_sightings - point->first;
    }
    return CN_OK;
}

static void fit_means(finder *f)
{
    for (uint32_t p = 0; p < f->n_points; p++) {
        seen_point *point = &f->points[p];
        for (size_t c = 0; c < 3; c++) {
            float sum = 0;
            for (uint32_t i = point->first; i < point->first + point->n; i++)
                sum += f->sightings[i].colour[c] - f->gain[f->sightings[i].photo][c];
            point->mean[c] = sum / (float)point->n; /* NaN where all is masked */
        }
    }
}

/* What a photo's sightings are off from their points' means, in a channel, or in the worst one (3). Returns how many.
 */
static size_t offsets(const finder *f, uint32_t photo, size_t channel, double *off)
{
    size_t n = 0;
    for (uint32_t p = 0; p < f->n_points; p++)
        for (uint32_t i = f->points[p].first; i < f->points[p].first + f->points[p].n; i++) {
            const sighting *s = &f->sightings[i];
            if (s->photo != photo) continue;
            off[n] = 0;
            for (size_t c = 0; c < 3 && channel == 3; c++)
                off[n] = fmax(off[n], fabs((double)(s->colour[c] - f->points[p].mean[c] - f->gain[photo][c])));
            if (channel < 3) off[n] = (double)(s->colour[channel] - f->points[p].mean[channel]);
            n++;
        }
    return n;
}

/* Means of points and gains of photos in turn, in stops, a channel on its own. Then how far a colour may be off in each
 * photo: a stop, or four standard deviations of a channel, so that a photo by night, whose light is another at every
 * place, is not taken for one with occluders. The worst of three channels has a median of 1.4 times that of one. */
static cn_status fit_colours(finder *f)
{
    enum { ROUNDS = 4, LEAST = 10 };
    double *off = malloc((f->n_sightings + (size_t)1) * sizeof *off);
    if (!off) return cn_fail(CN_ERR_NOMEM, "out of memory looking for occluders");
    for (int round = 0; round < ROUNDS; round++) {
        fit_means(f);
        for (uint32_t photo = 0; photo < f->tile->n_photos; photo++)
            for (size_t c = 0; c < 3; c++) {
                const size_t n = offsets(f, photo, c, off);
                if (n > LEAST) f->gain[photo][c] = (float)cn_select(off, n, n / 2);
            }
    }
    fit_means(f);
    for (uint32_t photo = 0; photo < f->tile->n_photos; photo++) {
        const size_t n = offsets(f, photo, 3, off);
        f->limit[photo] = n > LEAST ? (float)fmax(1, 4 * 1.4826 / 1.4 * cn_select(off, n, n / 2)) : INFINITY;
    }
    free(off);
    return CN_OK;
}

/* Whether a photo at `centre`, which does not track a point, should see it: another photo sees it from that side. */
static bool should_see(const finder *f, const seen_point *point, uint32_t photo, const double centre[3],
                       double *distance)
{
    const double *x = f->input->scene->points[point->point].xyz;
    double to[3], other[3];
    bool seen = false;
    for (int a = 0; a < 3; a++)
        to[a] = centre[a] - x[a];
    *distance = sqrt(cn_dot3(to, to));
    for (uint32_t i = point->first; i < point->first + point->n; i++) {
        const uint32_t by = f->sightings[i].photo;
        if (by == photo) return false;
        if (seen) continue;
        cn_view_centre(&f->input->scene->views[f->tile->photos[by]], other);
        for (int a = 0; a < 3; a++)
            other[a] -= x[a];
        const double far = sqrt(cn_dot3(other, other));
        seen =
            *distance > NEARER * far && *distance < FARTHER * far && cn_dot3(to, other) > SAME_SIDE * *distance * far;
    }
    return seen;
}

/* The least difference of the colours about a place from that of the point. At an edge a small error of the pose shows
 * another colour. */
static float least_difference(const finder *f, uint32_t photo, const double xy[2], const float mean[3])
{
    float least = INFINITY;
    for (int i = 0; i < 9; i++) {
        const float *colour = colour_at(f, photo, xy, i % 3 - 1, i / 3 - 1);
        float most = 0;
        for (size_t c = 0; c < 3; c++)
            most = fmaxf(most, fabsf(colour[c] - mean[c] - f->gain[photo][c]));
        if (!isnan(colour[0])) least = fminf(least, most);
    }
    return least;
}

/* Counts what the photo should see but does not track, by cells. */
static void note_untracked(finder *f, uint32_t photo)
{
    const cn_view *view = &f->input->scene->views[f->tile->photos[photo]];
    const cn_camera *camera = &f->input->scene->cameras[view->camera];
    double centre[3];
    cn_view_centre(view, centre);
    for (uint32_t p = 0; p < f->n_points; p++) {
        const seen_point *point = &f->points[p];
        double distance, cam[3], xy[2];
        if (!point->n || !should_see(f, point, photo, centre, &distance)) continue;
        cn_mat3_vec(view->rotation, f->input->scene->points[point->point].xyz, cam);
        for (int a = 0; a < 3; a++)
            cam[a] += view->translation[a];
        if (!cn_camera_project(camera, cam, xy)) continue;
        const int cell = cn_track_cell(camera, xy[0], xy[1]);
        if (cell < 0 || cn_track_is_hidden(f->near[photo], cell, distance)) continue;
        const float difference = least_difference(f, photo, xy, point->mean);
        if (difference > f->limit[photo] && isfinite(difference))
            f->changed[photo][cell]++;
        else
            f->usual[photo][cell]++;
    }
}

static float sum_about(const float count[CELLS], int cell)
{
    float sum = 0;
    for (int y = cell / X - 1; y <= cell / X + 1; y++)
        for (int x = cell % X - 1; x <= cell % X + 1; x++)
            sum += x >= 0 && y >= 0 && x < X && y < Y ? count[y * X + x] : 0;
    return sum;
}

/* Marks the cells in which something stands before what should be seen; returns how many. */
static uint32_t mark(const finder *f, uint32_t photo, uint8_t marked[CELLS])
{
    uint32_t n = 0;
    for (int cell = 0; cell < CELLS; cell++) {
        const float changed = sum_about(f->changed[photo], cell), usual = sum_about(f->usual[photo], cell),
                    tracked = sum_about(f->tracked[photo], cell);
        marked[cell] = f->changed[photo][cell] > 0 && changed >= FEWEST_CHANGED &&
                       changed >= (float)CHANGED * (changed + usual) && tracked <= (float)TRACKED * changed;
        n += marked[cell];
    }
    return n;
}

/* Mean colour and contrast of a photo's cells. */
typedef struct look {
    float mean[3], contrast; /* stops; NaN where all is masked */
} look;
static void look_at(const small_photo *s, look looks[CELLS])
{
    for (uint32_t cell = 0; cell < CELLS; cell++) {
        const uint32_t x0 = cell % X * s->width / X, x1 = (cell % X + 1) * s->width / X, y0 = cell / X * s->height / Y,
                       y1 = (cell / X + 1) * s->height / Y;
        double sum[3] = { 0 }, squares = 0, n = 0;
        for (uint32_t y = y0; y < y1; y++)
            for (uint32_t x = x0; x < x1; x++) {
                const float *colour = s->colour[y * s->width + x];
                if (isnan(colour[0])) continue;
                for (size_t c = 0; c < 3; c++)
                    sum[c] += (double)colour[c];
                squares += (double)(colour[1] * colour[1]);
                n++;
            }
        for (size_t c = 0; c < 3; c++)
            looks[cell].mean[c] = (float)(sum[c] / n);
        looks[cell].contrast = (float)sqrt(fmax(squares / n - sum[1] / n * (sum[1] / n), 0));
    }
}

/* The cells that belong together, from `first` on: marked ones of `marked`, with those diagonally beside them. */
static uint32_t component(uint8_t marked[CELLS], int first, int list[CELLS])
{
    uint32_t n = 0;
    list[n++] = first;
    marked[first] = 0;
    for (uint32_t i = 0; i < n; i++)
        for (int y = list[i] / X - 1; y <= list[i] / X + 1; y++)
            for (int x = list[i] % X - 1; x <= list[i] % X + 1; x++)
                if (x >= 0 && y >= 0 && x < X && y < Y && marked[y * X + x]) {
                    marked[y * X + x] = 0;
                    list[n++] = y * X + x;
                }
    return n;
}

static bool is_like(const look *a, const look *b)
{
    for (size_t c = 0; c < 3; c++)
        if (!(fabsf(a->mean[c] - b->mean[c]) < (float)LIKE_STOPS)) return false;
    const double ratio = ((double)a->contrast + LEAST_CONTRAST) / ((double)b->contrast + LEAST_CONTRAST);
    return ratio < LIKE_CONTRAST && ratio * LIKE_CONTRAST > 1;
}

/* The thing goes on into cells that look like it and of which nothing else is known; then one cell more, for its edge.
 */
static void spread(const finder *f, uint32_t photo, int list[CELLS], uint32_t n, const look looks[CELLS])
{
    uint8_t in[CELLS] = { 0 };
    look mean = { { 0 }, 0 };
    for (uint32_t i = 0; i < n; i++) {
        in[list[i]] = 1;
        for (size_t c = 0; c < 3; c++)
            mean.mean[c] += looks[list[i]].mean[c] / (float)n;
        mean.contrast += looks[list[i]].contrast / (float)n;
    }
    for (uint32_t i = 0; i < n; i++)
        for (int k = 0; k < 4; k++) {
            const int x = list[i] % X + (k == 0) - (k == 1), y = list[i] / X + (k == 2) - (k == 3), at = y * X + x;
            if (x < 0 || y < 0 || x >= X || y >= Y || in[at]) continue;
            if (f->tracked[photo][at] > 0 || f->usual[photo][at] > 1 || !is_like(&looks[at], &mean)) continue;
            in[at] = 1;
            list[n++] = at;
        }
    /* One cell more on each side. */
    for (uint32_t i = 0; i < n; i++)
        for (int y = list[i] / X - 1; y <= list[i] / X + 1; y++)
            for (int x = list[i] % X - 1; x <= list[i] % X + 1; x++)
                if (x >= 0 && y >= 0 && x < X && y < Y) f->found[photo][y] |= 1u << x;
}

static double share_of(const uint32_t cells[Y])
{
    int n = 0;
    for (int y = 0; y < Y; y++)
        for (int x = 0; x < X; x++)
            n += cells[y] >> x & 1;
    return (double)n / CELLS;
}

static cn_status find_in(finder *f, uint32_t photo, uint32_t *n_marked, bool *found)
{
    uint8_t marked[CELLS];
    int list[CELLS];
    note_untracked(f, photo);
    *found = false;
    if ((*n_marked = mark(f, photo, marked)) < FEWEST_CELLS) return CN_OK;
    look *looks = malloc(CELLS * sizeof *looks);
    if (!looks) return cn_fail(CN_ERR_NOMEM, "out of memory looking for occluders");
    look_at(&f->small[photo], looks);
    for (int cell = 0; cell < CELLS; cell++) {
        if (!marked[cell]) continue;
        const uint32_t n = component(marked, cell, list);
        if (n < FEWEST_TOGETHER) continue;
        spread(f, photo, list, n, looks);
        *found = true;
    }
    free(looks);
    if (share_of(f->found[photo]) > LARGEST) {
        memset(f->found[photo], 0, sizeof f->found[photo]);
        *found = false;
    }
    return CN_OK;
}

static cn_status begin(finder *f)
{
    const uint32_t n = f->tile->n_photos;
    f->row = cn_tracks_rows(f->input, f->tile);
    f->small = calloc(n, sizeof *f->small);
    f->gain = calloc(n, sizeof *f->gain);
    f->limit = calloc(n, sizeof *f->limit);
    f->near = malloc(n * sizeof *f->near);
    f->tracked = calloc(n, sizeof *f->tracked);
    f->changed = calloc(n, sizeof *f->changed);
    f->usual = calloc(n, sizeof *f->usual);
    if (!f->row || !f->small || !f->gain || !f->limit || !f->near || !f->tracked || !f->changed || !f->usual)
        return cn_fail(CN_ERR_NOMEM, "out of memory looking for occluders");
    for (uint32_t i = 0; i < n; i++)
        for (int cell = 0; cell < CELLS; cell++)
            f->near[i][cell] = INFINITY;
    for (uint32_t i = 0; i < n; i++)
        CN_TRY(shrink(f->input->pixels, f->input->scene->views[f->tile->photos[i]].photo, &f->small[i]));
    note_tracked(f);
    CN_TRY(gather(f));
    return fit_colours(f);
}

static void end(finder *f)
{
    for (uint32_t i = 0; f->small && i < f->tile->n_photos; i++)
        free(f->small[i].colour);
    free(f->row);
    free(f->small);
    free(f->points);
    free(f->sightings);
    free(f->gain);
    free(f->limit);
    free(f->near);
    free(f->tracked);
    free(f->changed);
    free(f->usual);
}

cn_status cn_occluders_find(const cn_plan_input *input, const cn_plan_tile *tile, cn_occluders *occluders)
{
    *occluders = (cn_occluders){ .n_photos = tile->n_photos };
    if (input->scene->n_points < MIN_POINTS || tile->n_photos < 3 || tile->n_photos > MOST_PHOTOS) return CN_OK;
    for (uint32_t i = 0; i < tile->n_photos; i++)
        if (input->scene->views[tile->photos[i]].photo >= cn_pixel_store_count(input->pixels)) return CN_OK;
    occluders->cells = calloc(tile->n_photos, sizeof *occluders->cells);
    if (!occluders->cells) return cn_fail(CN_ERR_NOMEM, "out of memory looking for occluders");
    finder f = { .input = input, .tile = tile, .found = occluders->cells };
    cn_status status = begin(&f);
    uint32_t n_touched = 0;
    for (uint32_t i = 0; i < tile->n_photos && status == CN_OK; i++) {
        uint32_t n_marked = 0;
        bool found = false;
        status = find_in(&f, i, &n_marked, &found);
        n_touched += n_marked > 0;
        occluders->n_found += found;
    }
    end(&f);
    if (status != CN_OK || n_touched > MOST_TOUCHED * tile->n_photos) {
        memset(occluders->cells, 0, tile->n_photos * sizeof *occluders->cells);
        occluders->n_found = 0;
    }
    if (status != CN_OK) cn_occluders_deinit(occluders);
    return status;
}

void cn_occluders_deinit(cn_occluders *occluders)
{
    free(occluders->cells);
    *occluders = (cn_occluders){ 0 };
}

double cn_occluders_share(const cn_occluders *occluders, uint32_t photo)
{
    return occluders->cells ? share_of(occluders->cells[photo]) : 0;
}
