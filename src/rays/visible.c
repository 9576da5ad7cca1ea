/* Which cells of a tile its views see. Most views look past most places. So cells are taken in blocks: a view whose
 * cone of rays misses the ball around a block is asked for none of its cells. */
#include "base/units.h"
#include "field/occupancy.h"
#include "math/linalg.h"
#include "pose/lens.h"
#include "rays/rays.h"

#include <math.h>
#include <stdlib.h>

/* At most this many of the views that may see a block are tested for its cells. Two views that see a cell are enough,
 * and views that are far apart find them. Not measured apart. */
enum { MAX_ASKED = 512 };
enum { BLOCK = 8, BLOCKS = CN_OCC_RES / BLOCK, CELLS = BLOCK * BLOCK * BLOCK };
/* A cell whose centre is outside the picture counts as seen if it is not farther from it than its own half diagonal,
 * and than this share of the picture's size. */
#define MARGIN 0.02

/* A view that is asked. */
typedef struct asked_view {
    const cn_ray_generator *generator;
    cn_lens_view lens;
    const float *alone_from_m; /* [CN_ALONE_PARTS]; NULL: never alone */
    const uint8_t *clearance;  /* its map */
    double widest;             /* angle to the axis; no ray of the picture and its margin is beyond it */
} asked_view;

typedef struct visible_task {
    const cn_box *box;
    uint8_t *usable;
    uint32_t n, needed;        /* needed: views that see a usable cell, or that look through a clear one */
    asked_view *views;         /* [n] */
    const cn_clear_maps *maps; /* NULL: the cells that are seen are wanted, not those that are clear */
} visible_task;

/* The widest ray goes through the edge of the picture, because the distortion of a lens only turns back beyond the last
 * ray it has. */
static double widest_angle(const cn_camera *camera)
{
    enum { POINTS = 16 };
    const bool is_fisheye = camera->lens == CN_LENS_OPENCV_FISHEYE;
    const double limit = is_fisheye ? CN_PI : CN_PI / 2, slack = 1.02; /* slack: the edge between the points */
    if (camera->lens == CN_LENS_EQUIRECTANGULAR) return CN_PI;
    double widest = 0;
    for (uint32_t i = 0; i < 4 * POINTS; i++) {
        const double along = (i % POINTS) / (double)POINTS, end = i / POINTS % 2 ? 1 : 0;
        const double x = i < 2 * POINTS ? along : end, y = i < 2 * POINTS ? end : 1 - along;
        double dir[3];
        if (cn_camera_unproject(camera, camera->width * (x + MARGIN * (2 * x - 1)),
                                camera->height * (y + MARGIN * (2 * y - 1)), dir) != CN_OK)
            return limit;
        widest = fmax(widest, acos(fmin(1, fmax(-1, dir[2] / sqrt(cn_dot3(dir, dir))))));
    }
    return fmin(limit, slack * widest);
}

static void place_in_camera(const cn_ray_generator *g, const cn_box *box, const double x[3], double cam[3])
{
    double rel[3];
    for (int a = 0; a < 3; a++)
        rel[a] = x[a] * box->half_extent[a] - g->origin[a];
    cn_mat3_tvec(g->world_from_cam, rel, cam);
}

/* A place as a view sees it. */
typedef struct seen_place {
    double distance_m, xy[2]; /* xy: pixels */
} seen_place;

/* Whether a view sees a place of the box, or what is nearer to it than reach_m. */
static bool sees(const asked_view *v, const cn_box *box, const double x[3], double reach_m, seen_place *at)
{
    const cn_ray_generator *g = v->generator;
    double cam[3];
    place_in_camera(g, box, x, cam);
    if (!cn_lens_project(&v->lens, cam, at->xy)) return false;
    at->distance_m = sqrt(cn_dot3(cam, cam));
    const double angle = reach_m / at->distance_m, margin_x = fmin(MARGIN * g->camera.width, v->lens.fx * angle),
                 margin_y = fmin(MARGIN * g->camera.height, v->lens.fy * angle);
    return at->xy[0] > -margin_x && at->xy[1] > -margin_y && at->xy[0] < g->camera.width + margin_x &&
           at->xy[1] < g->camera.height + margin_y;
}

/* Whether what stands there may be known from this view alone. */
static bool is_far_enough(const asked_view *v, const seen_place *at)
{
    const cn_camera *camera = &v->generator->camera;
    if (!v->alone_from_m) return false;
    const double x = at->xy[0] * CN_ALONE_X / camera->width, y = at->xy[1] * CN_ALONE_Y / camera->height;
    const int column = (int)fmin(fmax(x, 0), CN_ALONE_X - 1), row = (int)fmin(fmax(y, 0), CN_ALONE_Y - 1);
    return at->distance_m >= (double)v->alone_from_m[row * CN_ALONE_X + column];
}

/* Whether the view may see a part of the ball. */
static bool may_see(const asked_view *v, const cn_box *box, const double centre[3], double radius_m)
{
    double cam[3];
    place_in_camera(v->generator, box, centre, cam);
    const double distance = sqrt(cn_dot3(cam, cam));
    if (distance <= radius_m) return true;
    return acos(fmin(1, fmax(-1, cam[2] / distance))) <= v->widest + asin(radius_m / distance);
}

/* The cells of a block, their centres (box units), and a ball that holds these: centre in box units. */
typedef struct block {
    uint32_t cell[CELLS];
    double centre[CELLS][3];
    double ball_centre[3], ball_radius_m;
} block;

static void block_init(block *b, uint32_t x, uint32_t y, uint32_t z, const cn_box *box)
{
    double low[3] = { INFINITY, INFINITY, INFINITY }, high[3] = { -INFINITY, -INFINITY, -INFINITY };
    for (uint32_t i = 0; i < CELLS; i++) {
        const uint32_t cx = x * BLOCK + i % BLOCK, cy = y * BLOCK + i / BLOCK % BLOCK;
        const uint32_t cz = z * BLOCK + i / (BLOCK * BLOCK);
        float centre[3];
        b->cell[i] = (cz * CN_OCC_RES + cy) * CN_OCC_RES + cx;
        cn_occupancy_centre(b->cell[i], centre);
        for (int a = 0; a < 3; a++) {
            b->centre[i][a] = (double)centre[a];
            low[a] = fmin(low[a], b->centre[i][a]);
            high[a] = fmax(high[a], b->centre[i][a]);
        }
    }
    double squared = 0;
    for (int a = 0; a < 3; a++) {
        const double half_m = 0.5 * (high[a] - low[a]) * box->half_extent[a];
        b->ball_centre[a] = 0.5 * (low[a] + high[a]);
        squared += half_m * half_m;
    }
    b->ball_radius_m = sqrt(squared);
}

/* The views that see a cell go to the front of the list, because the next cell is near it. */
static bool is_usable(const visible_task *task, const double x[3], double reach_m, const asked_view **views, uint32_t n)
{
    uint32_t seen = 0;
    for (uint32_t i = 0; i < n && seen < task->needed; i++) {
        const asked_view *v = views[i];
        seen_place at;
        if (!sees(v, task->box, x, reach_m, &at)) continue;
        if (is_far_enough(v, &at)) return true;
        views[i] = views[seen];
        views[seen++] = v;
    }
    return seen >= task->needed;
}

/* Whether the view's map is clear all over the cell. Tests the cell's centre first. */
static bool looks_through(const asked_view *v, const visible_task *task, uint32_t cell, const double centre[3])
{
    const cn_ray_generator *g = v->generator;
    const double scale_x = (double)task->maps->columns / g->camera.width,
                 scale_y = (double)task->maps->rows / g->camera.height;
    double cam[3], at[2], corner[3], xy[2];
    place_in_camera(g, task->box, centre, cam);
    if (!cn_lens_project(&v->lens, cam, at)) return false;
    at[0] *= scale_x, at[1] *= scale_y;
    if (!(at[0] >= 0 && at[1] >= 0 && at[0] < task->maps->columns && at[1] < task->maps->rows)) return false;
    const double room = v->clearance[(uint32_t)at[1] * task->maps->columns + (uint32_t)at[0]] - 1.0;
    for (uint32_t i = 0; i < 8 && room > 0; i++) {
        if (!cn_occupancy_corner(cell, i, corner)) return false;
        place_in_camera(g, task->box, corner, cam);
        if (!cn_lens_project(&v->lens, cam, xy)) return false;
        if (!(xy[0] >= 0 && xy[1] >= 0 && xy[0] <= g->camera.width && xy[1] <= g->camera.height)) return false;
        if (!(fabs(xy[0] * scale_x - at[0]) < room && fabs(xy[1] * scale_y - at[1]) < room)) return false;
    }
    return room > 0;
}

static bool is_clear(const visible_task *task, uint32_t cell, const double x[3], const asked_view **views, uint32_t n)
{
    uint32_t clear = 0;
    for (uint32_t i = 0; i < n && clear < task->needed; i++)
        clear += looks_through(views[i], task, cell, x);
    return clear >= task->needed;
}

/* Of the views that may see the block, at most MAX_ASKED, evenly. */
static uint32_t choose_views(const visible_task *task, const block *b, const asked_view **views)
{
    uint32_t may = 0, met = 0, n = 0;
    for (uint32_t i = 0; i < task->n; i++)
        may += may_see(&task->views[i], task->box, b->ball_centre, b->ball_radius_m);
    const uint32_t wanted = may < MAX_ASKED ? may : MAX_ASKED;
    for (uint32_t i = 0; i < task->n && n < wanted; i++)
        if (may_see(&task->views[i], task->box, b->ball_centre, b->ball_radius_m) &&
            met++ == (uint64_t)n * may / wanted)
            views[n++] = &task->views[i];
    return n;
}

static void visible_slice(void *user, size_t slice, unsigned worker)
{
    (void)worker;
    const visible_task *task = user;
    for (uint32_t x = 0; x < BLOCKS; x++) {
        block b;
        const asked_view *views[MAX_ASKED];
        block_init(&b, x, (uint32_t)slice % BLOCKS, (uint32_t)slice / BLOCKS, task->box);
        const uint32_t n = choose_views(task, &b, views);
        for (uint32_t i = 0; i < CELLS; i++) {
            uint8_t *usable = &task->usable[b.cell[i]];
            if (!task->maps)
                *usable = is_usable(task, b.centre[i], b.ball_radius_m / (BLOCK - 1), views, n);
            else if (*usable && is_clear(task, b.cell[i], b.centre[i], views, n))
                *usable = 0;
        }
    }
}

static bool ask(visible_task *task, cn_pool *pool, const cn_seeing_views *views)
{
    task->needed = views->n < 2 ? views->n : 2;
    task->n = views->n;
    task->views = malloc(sizeof *task->views * (views->n + 1u));
    if (!task->views) return false;
    for (uint32_t i = 0; i < views->n; i++) {
        const cn_ray_generator *g = &views->generators[i];
        asked_view *v = &task->views[i];
        *v = (asked_view){ .generator = g, .lens = cn_lens_unpack(&g->camera), .widest = widest_angle(&g->camera) };
        if (views->alone_from_m) v->alone_from_m = views->alone_from_m + (size_t)i * CN_ALONE_PARTS;
        if (task->maps) v->clearance = task->maps->clearance + (size_t)i * task->maps->columns * task->maps->rows;
    }
    cn_pool_run(pool, (size_t)BLOCKS * BLOCKS, visible_slice, task);
    free(task->views);
    return true;
}

bool cn_rays_visible_cells(cn_pool *pool, const cn_box *box, const cn_seeing_views *views, uint8_t *usable)
{
    visible_task task = { .box = box, .usable = usable };
    return ask(&task, pool, views);
}

bool cn_rays_clear_cells(cn_pool *pool, const cn_box *box, const cn_seeing_views *views, const cn_clear_maps *maps,
                         uint8_t *usable)
{
    visible_task task = { .box = box, .usable = usable, .maps = maps };
    return !views->n || ask(&task, pool, views);
}
