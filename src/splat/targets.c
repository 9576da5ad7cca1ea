#include "splat/targets.h"

#include "base/clock.h"
#include "base/scratch.h"
#include "math/linalg.h"

#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

enum { FEW_VIEWS = 64, LEAST_WIDTH = 32, PIXELS_EACH = 32 };
#define LEAST_ALIKE 0.7 /* cosine between the axes of neighbours */

void cn_targets_deinit(cn_targets *t)
{
    if (t->pictures) munmap((void *)(uintptr_t)t->pictures, t->size[0]);
    if (t->depths) munmap((void *)(uintptr_t)t->depths, t->size[1]);
    for (int i = 0; t->list && i < 2; i++)
        if (t->fd[i] >= 0) close(t->fd[i]);
    cn_clear_space_deinit(&t->clear);
    free(t->list);
    *t = (cn_targets){ 0 };
}

/* ---- where to look from ---- */

static void add(cn_targets *t, const cn_camera *camera, const cn_view *view)
{
    cn_target *to = &t->list[t->n++];
    *to = (cn_target){ .view = *view, .camera = *camera };
    to->view.name = NULL;
    cn_view_centre(view, to->eye);
}

/* The six faces of a cube about a photo of all directions: x_face = rotation * x_photo. */
static const double faces[][9] = {
    { 1, 0, 0, 0, 1, 0, 0, 0, 1 },  { 0, 0, -1, 0, 1, 0, 1, 0, 0 }, { -1, 0, 0, 0, 1, 0, 0, 0, -1 },
    { 0, 0, 1, 0, 1, 0, -1, 0, 0 }, { 1, 0, 0, 0, 0, 1, 0, -1, 0 }, { 1, 0, 0, 0, 0, -1, 0, 1, 0 },
};
enum { FACES = sizeof faces / sizeof *faces };

static bool is_panorama(const cn_splat_source *source, uint32_t i)
{
    return source->scene->cameras[source->scene->views[source->views[i]].camera].lens == CN_LENS_EQUIRECTANGULAR;
}

static void add_photo(cn_targets *t, const cn_splat_source *source, uint32_t i)
{
    const cn_view *view = &source->scene->views[source->views[i]];
    const cn_camera *full = &source->scene->cameras[view->camera];
    cn_camera camera;
    if (!is_panorama(source, i)) {
        const double height = fmin(fmax(3, round((double)full->height * t->width_px / full->width)), 16384);
        cn_camera_resize(full, t->width_px, (uint32_t)height, &camera);
        camera = cn_splats_camera(&camera);
        add(t, &camera, view);
        return;
    }
    const uint32_t side = (uint32_t)fmax(round(0.25 * t->width_px), LEAST_WIDTH);
    const double half = 0.5 * side;
    camera =
        (cn_camera){ .lens = CN_LENS_PINHOLE, .width = side, .height = side, .params = { half, half, half, half } };
    for (int k = 0; k < FACES; k++) {
        cn_view face = *view;
        cn_mat3_mul(faces[k], view->rotation, face.rotation);
        cn_mat3_vec(faces[k], view->translation, face.translation);
        add(t, &camera, &face);
    }
}

/* The view half-way between two. */
static cn_view between(const cn_view *a, const cn_view *b)
{
    cn_view out = *a;
    double qa[4], qb[4], q[4], from[3], to[3], middle[3];
    cn_mat3_to_quat(a->rotation, qa);
    cn_mat3_to_quat(b->rotation, qb);
    cn_quat_slerp(qa, qb, 0.5, q);
    cn_quat_to_mat3(q, out.rotation);
    cn_view_centre(a, from);
    cn_view_centre(b, to);
    for (int k = 0; k < 3; k++)
        middle[k] = 0.5 * (from[k] + to[k]);
    cn_mat3_vec(out.rotation, middle, out.translation);
    for (int k = 0; k < 3; k++)
        out.translation[k] = -out.translation[k];
    return out;
}

/* The nearest of the first n that looks the same way, and is not `but`; n when there is none. */
static uint32_t neighbour_of(const cn_targets *t, uint32_t n, uint32_t of, uint32_t but)
{
    uint32_t best = n;
    double nearest = INFINITY;
    for (uint32_t i = 0; i < n; i++) {
        const double distance = cn_distance3(t->list[i].eye, t->list[of].eye);
        const double alike = cn_dot3(t->list[i].view.rotation + 6, t->list[of].view.rotation + 6);
        if (i == of || i == but || alike < LEAST_ALIKE || !(distance > 0 && distance < nearest)) continue;
        best = i;
        nearest = distance;
    }
    return best;
}

/* Views between each of the n and its two neighbours, each pair once. */
static void add_between(cn_targets *t, uint32_t n)
{
    bool paired[FEW_VIEWS][FEW_VIEWS] = { 0 };
    for (uint32_t i = 0; i < n; i++)
        for (uint32_t k = 0, other = n; k < 2; k++) {
            other = neighbour_of(t, n, i, other);
            if (other == n) break;
            if (paired[i][other]) continue;
            paired[i][other] = paired[other][i] = true;
            const cn_view view = between(&t->list[i].view, &t->list[other].view);
            add(t, &t->list[i].camera, &view);
        }
}

static cn_status choose(cn_targets *t, const cn_splat_source *source)
{
    for (uint32_t i = 0; i < source->n_views; i++)
        add_photo(t, source, i);
    const uint32_t n = t->n;
    if (n < FEW_VIEWS) add_between(t, n);
    return t->n ? CN_OK : cn_fail(CN_ERR_DATA, "no photo that a tile was trained on has a pose");
}

/* ---- rendering ---- */

static cn_status append(cn_targets *t, int which, const void *data, size_t size)
{
    const char *from = data;
    for (size_t done = 0; done < size;) {
        const ssize_t wrote = pwrite(t->fd[which], from + done, size - done, (off_t)(t->size[which] + done));
        if (wrote > 0)
            done += (size_t)wrote;
        else if (wrote == 0 || errno != EINTR)
            return cn_scratch_failure(t->path, "write", wrote ? errno : EIO);
    }
    t->size[which] += size;
    return CN_OK;
}

static uint8_t to_byte(float value)
{
    return (uint8_t)lrintf(fminf(fmaxf(value, 0), 1) * 255);
}

/* Display colours over black, and opacity, tile by tile. */
static void to_tiles(const cn_picture *p, const float *alpha, uint8_t *out)
{
    const size_t across = (p->width + CN_SPLAT_TILE - 1) / CN_SPLAT_TILE;
    for (uint32_t y = 0; y < p->height; y++)
        for (uint32_t x = 0; x < p->width; x++) {
            const size_t at = (size_t)y * p->width + x, tile = y / CN_SPLAT_TILE * across + x / CN_SPLAT_TILE;
            uint8_t *to = out + tile * 4 * CN_SPLAT_TILE_PIXELS + y % CN_SPLAT_TILE * CN_SPLAT_TILE + x % CN_SPLAT_TILE;
            for (size_t k = 0; k < 3; k++)
                to[k * CN_SPLAT_TILE_PIXELS] = to_byte(p->rgba[4 * at + k] * alpha[at]);
            to[3 * (size_t)CN_SPLAT_TILE_PIXELS] = to_byte(alpha[at]);
        }
}

/* rgba becomes display colours, as they are without the alpha. */
static cn_status store(cn_targets *t, cn_target *to, const cn_splat_source *source, cn_picture *p)
{
    const size_t n = (size_t)p->width * p->height, size = cn_raster_target_size(p->width, p->height);
    uint8_t *tiles = calloc(size, 1);
    float *alpha = malloc(n * sizeof *alpha);
    cn_status status = tiles && alpha ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory for a picture");
    for (size_t i = 0; status == CN_OK && i < n; i++) {
        alpha[i] = fminf(fmaxf(p->rgba[4 * i + 3], 0), 1);
        if (!(p->depth[i] > 0)) p->depth[i] = alpha[i] > 0.5f ? INFINITY : 0;
        if (alpha[i] < 0.5f) p->depth[i] = 0;
        for (size_t k = 0; k < 3; k++)
            p->rgba[4 * i + k] /= fmaxf(alpha[i], 1e-6f);
    }
    if (status == CN_OK) status = cn_colour_to_display(source->colour, &source->display, p->rgba, n, 4);
    if (status == CN_OK) {
        to_tiles(p, alpha, tiles);
        to->pixels = t->size[0];
        to->depths = t->size[1] / sizeof(float);
        status = append(t, 0, tiles, size);
    }
    if (status == CN_OK) status = append(t, 1, p->depth, n * sizeof *p->depth);
    free(tiles);
    free(alpha);
    return status;
}

static cn_status render(cn_targets *t, const cn_context *ctx, const cn_splat_source *source, double started)
{
    for (uint32_t i = 0; i < t->n; i++) {
        cn_target *to = &t->list[i];
        cn_picture picture;
        if (cn_stopping(ctx)) return cn_fail(CN_ERR_INTERRUPTED, "stopped while rendering the views for splats");
        CN_TRY(cn_picture_init(&picture, to->camera.width, to->camera.height));
        cn_status status = source->draw(source->user, ctx, &to->camera, &to->view, &picture);
        if (status == CN_OK) status = store(t, to, source, &picture);
        cn_picture_deinit(&picture);
        CN_TRY(status);
        const double elapsed = cn_now_s() - started, done = i + 1;
        const cn_progress_report report = { "export", "splats: views", done,
                                            t->n,     elapsed,         elapsed / done * (t->n - done),
                                            NULL };
        cn_progress(ctx, &report);
    }
    return CN_OK;
}

static cn_status map(cn_targets *t, int which, const void **at)
{
    void *mapped = mmap(NULL, t->size[which], PROT_READ, MAP_PRIVATE, t->fd[which], 0);
    if (mapped == MAP_FAILED) return cn_scratch_failure(t->path, "read", errno);
    *at = mapped;
    return CN_OK;
}

static cn_status make(cn_targets *t, const cn_context *ctx, const cn_splat_source *source, const char *path)
{
    const void *at[2] = { NULL, NULL };
    for (int i = 0; i < 2; i++)
        CN_TRY(cn_scratch_open(path, &t->fd[i]));
    CN_TRY(cn_clear_space_init(&t->clear, source->scene, source->near_m));
    CN_TRY(choose(t, source));
    CN_TRY(render(t, ctx, source, cn_now_s()));
    CN_TRY(map(t, 0, &at[0]));
    t->pictures = at[0];
    CN_TRY(map(t, 1, &at[1]));
    t->depths = at[1];
    return CN_OK;
}

/* As wide as the photos, or as the budget asks for. */
static uint32_t width_of(const cn_splat_source *source, uint32_t budget)
{
    const uint32_t n = source->n_views < FEW_VIEWS ? source->n_views * 5 / 2 : source->n_views;
    double aspect = 0;
    for (uint32_t i = 0; i < source->n_views; i++) {
        const cn_camera *camera = &source->scene->cameras[source->scene->views[source->views[i]].camera];
        aspect += (double)camera->height / camera->width / source->n_views;
    }
    const double width = sqrt((double)PIXELS_EACH * budget / (fmax(n, 1) * fmax(aspect, 0.1)));
    return (uint32_t)fmin(fmax(round(width), LEAST_WIDTH), source->width_px);
}

cn_status cn_targets_make(cn_targets *t, const cn_context *ctx, const cn_splat_source *source, uint32_t budget,
                          const char *path)
{
    uint32_t n = 0;
    for (uint32_t i = 0; i < source->n_views; i++)
        n += is_panorama(source, i) ? FACES : 1;
    *t = (cn_targets){ .path = path, .fd = { -1, -1 }, .most = 3 * n, .width_px = width_of(source, budget) };
    t->list = calloc(t->most + (size_t)1, sizeof *t->list);
    if (!t->list) return cn_fail(CN_ERR_NOMEM, "out of memory for %u views", t->most);
    const cn_status status = make(t, ctx, source, path);
    if (status != CN_OK) cn_targets_deinit(t);
    return status;
}
