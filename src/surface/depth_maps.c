#include "surface/depth_maps.h"

#include "base/file.h"
#include "base/scratch.h"
#include "math/linalg.h"
#include "surface/lattice.h"

#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

#define MIN_ALPHA 0.9f
#define MAX_BEND 0.03f /* fraction of the depth by which a pixel may differ from the mean of its neighbours */
#define MAX_JUMP 0.05f /* between the four pixels that a depth is interpolated from */

/* The file's beginning. */
typedef struct head {
    char magic[8];
    uint64_t key;
    uint32_t done;    /* maps that are whole */
    uint32_t refined; /* of them, in the second part of the file */
    uint32_t checked; /* 1: all of these are final */
    uint32_t pad[9];
} head;
static const char magic[8] = "CNDEPTH2";
_Static_assert(sizeof(head) == 64, "pixels begin there");

static cn_status read_or_write(cn_depth_maps *m, bool writing, void *bytes, size_t size, off_t at)
{
    char *from = bytes;
    for (size_t done = 0; done < size;) {
        const ssize_t n = writing ? pwrite(m->fd, from + done, size - done, at + (off_t)done)
                                  : pread(m->fd, from + done, size - done, at + (off_t)done);
        if (n > 0)
            done += (size_t)n;
        else if (n == 0 || errno != EINTR)
            return cn_scratch_failure(m->path, writing ? "write" : "read", n ? errno : EIO);
    }
    return CN_OK;
}

/* The maps' bytes are on disk before the head counts them. */
static cn_status write_head(cn_depth_maps *m, uint32_t done)
{
    head h = { .key = m->key, .done = done, .refined = m->refined, .checked = m->checked };
    memcpy(h.magic, magic, sizeof h.magic);
    if (m->name && fdatasync(m->fd) != 0) return cn_scratch_failure(m->path, "write", errno);
    return read_or_write(m, true, &h, sizeof h, 0);
}

static cn_status open_named(cn_depth_maps *m)
{
    head h = { 0 };
    m->name = cn_format("%s.depths", m->path);
    if (!m->name) return cn_fail(CN_ERR_NOMEM, "out of memory");
    m->fd = open(m->name, O_RDWR | O_CREAT | O_CLOEXEC, 0666);
    if (m->fd < 0) return cn_scratch_failure(m->path, "make", errno);
    if (pread(m->fd, &h, sizeof h, 0) == (ssize_t)sizeof h && memcmp(h.magic, magic, sizeof magic) == 0 &&
        h.key == m->key) {
        m->ready = h.done;
        m->refined = h.refined;
        m->checked = h.checked;
        return CN_OK;
    }
    if (ftruncate(m->fd, 0) != 0) return cn_scratch_failure(m->path, "write", errno);
    return write_head(m, 0);
}

cn_status cn_depth_maps_open(cn_depth_maps *m, const char *path, uint64_t key, uint32_t n)
{
    *m = (cn_depth_maps){ .path = path, .fd = -1, .key = key, .maps = calloc(n + (size_t)1, sizeof *m->maps) };
    if (!m->maps) return cn_fail(CN_ERR_NOMEM, "out of memory for %u depth maps", n);
    return key ? open_named(m) : cn_scratch_open(path, &m->fd);
}

void cn_depth_maps_close(cn_depth_maps *m, bool keep)
{
    if (m->mapped) munmap(m->mapped, m->mapped_size);
    if (m->maps && m->fd >= 0) close(m->fd);
    if (m->name && m->fd >= 0 && !keep) unlink(m->name);
    free(m->name);
    free(m->maps);
    *m = (cn_depth_maps){ .fd = -1 };
}

/* ---- from a picture to pixels ---- */

static bool is_sky(const cn_picture *p, size_t at)
{
    return !(p->depth[at] > 0) && p->rgba[4 * at + 3] > 0.99f;
}

/* The expected depth is wrong at edges, between foreground and background: leave out pixels where depth bends. */
static bool smooth_at(const cn_picture *p, uint32_t x, uint32_t y)
{
    const size_t at = (size_t)y * p->width + x, steps[2] = { 1, p->width };
    const float d = p->depth[at];
    if (x < 1 || y < 1 || x + 1 >= p->width || y + 1 >= p->height || !(d > 0)) return false;
    if (p->rgba[4 * at + 3] < MIN_ALPHA) return false;
    for (int k = 0; k < 2; k++) {
        const float before = p->depth[at - steps[k]], after = p->depth[at + steps[k]];
        if (!(before > 0 && after > 0) || fabsf(before + after - 2 * d) > MAX_BEND * d) return false;
    }
    return true;
}

static cn_status convert(const cn_surface_source *source, cn_picture *p, cn_depth_pixel *pixels)
{
    const size_t n = (size_t)p->width * p->height;
    for (size_t i = 0; i < n; i++) {
        const bool known = is_sky(p, i) || smooth_at(p, (uint32_t)(i % p->width), (uint32_t)(i / p->width));
        pixels[i] = (cn_depth_pixel){ is_sky(p, i) ? INFINITY : p->depth[i], { 0 }, known ? CN_LATTICE_BAND : 0 };
    }
    for (size_t i = 0; i < n; i++) {
        const float alpha = fmaxf(p->rgba[4 * i + 3], 1e-6f);
        for (size_t k = 0; k < 3; k++)
            p->rgba[4 * i + k] /= alpha;
    }
    CN_TRY(cn_colour_to_display(source->colour, &source->display, p->rgba, n, 4));
    for (size_t i = 0; i < n; i++)
        for (size_t k = 0; k < 3; k++)
            pixels[i].rgb[k] = (uint8_t)lrintf(fminf(fmaxf(p->rgba[4 * i + k], 0), 1) * 255);
    return CN_OK;
}

/* ---- adding a map ---- */

static double half_angle_of(const cn_camera *camera)
{
    double largest = 0, dir[3];
    for (int i = 0; i < 8; i++) { /* corners and middles of the sides */
        const double x = (i % 3) / 2.0, y = i < 3 ? 0 : i < 6 ? 1 : 0.5;
        const double px[2] = { (i < 6 ? x : i - 6) * camera->width, y * camera->height };
        if (cn_camera_unproject(camera, px[0], px[1], dir) != CN_OK) return M_PI;
        largest = fmax(largest, acos(fmin(fmax(dir[2], -1), 1)));
    }
    return largest + 0.02;
}

static cn_status append(cn_depth_maps *m, cn_depth_pixel *pixels, size_t n)
{
    const off_t at = (off_t)(sizeof(head) + m->n_pixels * sizeof *pixels);
    const bool ready = m->n < m->ready;
    CN_TRY(read_or_write(m, !ready, pixels, n * sizeof *pixels, at));
    if (!ready) CN_TRY(write_head(m, m->n + 1));
    m->n_pixels += n;
    return CN_OK;
}

static cn_status draw(const cn_context *ctx, const cn_surface_source *source, const cn_depth_map *map,
                      cn_depth_pixel *pixels)
{
    cn_picture picture;
    CN_TRY(cn_picture_init(&picture, map->camera.width, map->camera.height));
    cn_status status = source->draw(source->user, ctx, &map->camera, map->view, &picture);
    if (status == CN_OK) status = convert(source, &picture, pixels);
    cn_picture_deinit(&picture);
    return status;
}

cn_status cn_depth_maps_add(cn_depth_maps *m, const cn_context *ctx, const cn_surface_source *source,
                            const cn_view *view)
{
    const cn_camera *full = &source->scene->cameras[view->camera];
    const double height = fmin(fmax(3, round((double)full->height * source->width_px / full->width)), 65535);
    cn_depth_map *map = &m->maps[m->n];
    *map = (cn_depth_map){ .view = view, .first = m->n_pixels };
    cn_camera_resize(full, source->width_px, (uint32_t)height, &map->camera);
    cn_view_centre(view, map->centre);
    map->half_angle = half_angle_of(&map->camera);
    const size_t n = (size_t)map->camera.width * map->camera.height;
    cn_depth_pixel *pixels = malloc(n * sizeof *pixels);
    if (!pixels) return cn_fail(CN_ERR_NOMEM, "out of memory for the depths of %s", view->name);
    cn_status status = m->n < m->ready ? CN_OK : draw(ctx, source, map, pixels);
    if (status == CN_OK) status = append(m, pixels, n);
    for (size_t i = 0; status == CN_OK && i < n; i++)
        if (pixels[i].band) map->far_m = fmax(map->far_m, (double)pixels[i].depth_m);
    free(pixels);
    m->n += status == CN_OK;
    return status;
}

/* A write through the mapping to a hole of the file kills the process when the disk is full: the file gets its blocks
 * before it is mapped. */
static cn_status take_room(const cn_depth_maps *m, size_t size)
{
    int error;
    do
        error = posix_fallocate(m->fd, 0, (off_t)size);
    while (error == EINTR);
    return error ? cn_scratch_failure(m->path, "write", error) : CN_OK;
}

cn_status cn_depth_maps_finish(cn_depth_maps *m, bool refine)
{
    const size_t part = m->n_pixels * sizeof *m->pixels, size = sizeof(head) + (refine ? 2 : 1) * part;
    if (!part) return cn_fail(CN_ERR_DATA, "no photo has a pose; run `conurb poses` first");
    CN_TRY(take_room(m, size));
    void *at = mmap(NULL, size, PROT_READ | PROT_WRITE, MAP_SHARED, m->fd, 0);
    if (at == MAP_FAILED) return cn_scratch_failure(m->path, "read", errno);
    m->mapped = at;
    m->mapped_size = size;
    m->pixels = (cn_depth_pixel *)((char *)at + sizeof(head));
    if (refine) {
        m->rendered = m->pixels;
        m->pixels += m->n_pixels;
    }
    return CN_OK;
}

cn_status cn_depth_maps_keep(cn_depth_maps *m, uint32_t refined, bool checked)
{
    m->refined = refined;
    m->checked = checked;
    if (!m->name) return CN_OK;
    if (msync(m->mapped, m->mapped_size, MS_SYNC) != 0) return cn_scratch_failure(m->path, "write", errno);
    return write_head(m, m->n);
}

/* ---- looking ---- */

typedef struct ranked {
    double distance_m;
    uint32_t map;
} ranked;

static int by_distance(const void *a, const void *b)
{
    const ranked *x = a, *y = b;
    if (x->distance_m < y->distance_m || x->distance_m > y->distance_m) return x->distance_m < y->distance_m ? -1 : 1;
    return x->map < y->map ? -1 : x->map > y->map;
}

cn_status cn_depth_maps_nearest(const cn_depth_maps *m, uint32_t first, uint32_t n, uint32_t n_nearest,
                                uint32_t *nearest)
{
    ranked *list = malloc((m->n + (size_t)1) * sizeof *list);
    if (!list) return cn_fail(CN_ERR_NOMEM, "out of memory for %u depth maps", m->n);
    for (uint32_t i = 0; i < m->n; i++) {
        const bool own = i >= first && i < first + n;
        list[i] = (ranked){ own ? -1 : INFINITY, i };
        for (uint32_t k = first; !own && k < first + n; k++)
            list[i].distance_m = fmin(list[i].distance_m, cn_distance3(m->maps[i].centre, m->maps[k].centre));
    }
    qsort(list, m->n, sizeof *list, by_distance);
    for (uint32_t i = 0; i < n_nearest; i++)
        nearest[i] = list[i].map;
    free(list);
    return CN_OK;
}

/* Inverse depth is linear on a plane, seen through a pinhole. */
static double depth_between(const cn_depth_pixel *const corner[4], double u, double v, const cn_depth_pixel *nearest)
{
    float low = INFINITY, high = 0;
    for (int i = 0; i < 4; i++) {
        if (!corner[i]->band) return (double)nearest->depth_m;
        low = fminf(low, corner[i]->depth_m);
        high = fmaxf(high, corner[i]->depth_m);
    }
    if (!(high - low <= MAX_JUMP * low)) return (double)nearest->depth_m;
    const double top = (1 - u) / (double)corner[0]->depth_m + u / (double)corner[1]->depth_m,
                 bottom = (1 - u) / (double)corner[2]->depth_m + u / (double)corner[3]->depth_m;
    return 1 / ((1 - v) * top + v * bottom);
}

bool cn_depth_map_ray(const cn_depth_map *map, uint32_t x, uint32_t y, double away[3])
{
    double dir[3];
    if (cn_camera_unproject(&map->camera, x + 0.5, y + 0.5, dir) != CN_OK) return false;
    cn_mat3_tvec(map->view->rotation, dir, away);
    return true;
}

bool cn_depth_map_look(const cn_depth_maps *m, const cn_depth_map *map, const double xyz[3], cn_depth_sight *sight)
{
    const uint32_t width = map->camera.width, height = map->camera.height;
    double there[3], px[2];
    cn_mat3_vec(map->view->rotation, xyz, there);
    for (int k = 0; k < 3; k++)
        there[k] += map->view->translation[k];
    if (!cn_camera_project(&map->camera, there, px)) return false;
    const double x = px[0] - 0.5, y = px[1] - 0.5;
    if (!(x >= 0 && y >= 0 && x < width - 1 && y < height - 1)) return false;
    const uint32_t x0 = (uint32_t)x, y0 = (uint32_t)y;
    const double u = x - x0, v = y - y0;
    const cn_depth_pixel *first = m->pixels + map->first + (size_t)y0 * width + x0;
    const cn_depth_pixel *const corner[4] = { first, first + 1, first + width, first + width + 1 };
    sight->pixel = corner[(v >= 0.5 ? 2 : 0) + (u >= 0.5)];
    if (!sight->pixel->band) return false;
    sight->distance_m = cn_norm3(there);
    sight->sight_m = depth_between(corner, u, v, sight->pixel) - sight->distance_m;
    return true;
}

bool cn_depth_map_reaches(const cn_depth_map *map, const double centre[3], double radius_m, double margin_m)
{
    double there[3];
    cn_mat3_vec(map->view->rotation, centre, there);
    for (int k = 0; k < 3; k++)
        there[k] += map->view->translation[k];
    const double distance = cn_norm3(there);
    if (distance <= radius_m) return true;
    if (distance - radius_m > map->far_m + margin_m) return false;
    return acos(fmin(fmax(there[2] / distance, -1), 1)) - asin(radius_m / distance) <= map->half_angle;
}
