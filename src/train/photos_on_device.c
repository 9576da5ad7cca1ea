/* The photos as other devices read them to draw rays: a record of each, and maps, which the device asks for once. */
#include "image/image.h"
#include "photo/store.h"
#include "train/trainer.h"

#include <math.h>
#include <string.h>

/* Kinds of maps; the photos' maps of one kind follow each other. */
enum { PIXELS, DIRECTIONS, DEPTHS, STEREO, NORMALS };

void cn_train_photos_carve(cn_train_photos *p, uint32_t n_photos, cn_arena *arena)
{
    p->record = CN_ARENA_NEW(arena, cn_step_photo, n_photos);
    p->map = CN_ARENA_NEW(arena, cn_train_map, CN_TRAIN_MAPS * (size_t)n_photos);
    p->bytes = CN_ARENA_NEW(arena, uint64_t, CN_TRAIN_MAPS * (size_t)n_photos);
}

static uint64_t pixels_of(const cn_train_photo *photo)
{
    return (uint64_t)photo->size.width * photo->size.height;
}

static uint32_t add(cn_train_photos *p, uint32_t photo, uint32_t kind, uint64_t bytes)
{
    p->map[p->n] = (cn_train_map){ photo, kind };
    p->bytes[p->n] = bytes;
    return p->n++;
}

static bool same_rays(const cn_train_photo *a, const cn_train_photo *b)
{
    const cn_camera *x = &a->generator.camera, *y = &b->generator.camera;
    return x->lens == y->lens && x->width == y->width && x->height == y->height && a->size.width == b->size.width &&
           a->size.height == b->size.height && memcmp(x->params, y->params, sizeof x->params) == 0;
}

/* Photos of one camera and one size share the map of their directions. */
static uint32_t directions_of(cn_train_photos *p, const cn_sampler *s, uint32_t photo)
{
    const cn_train_photo *of = &s->photos[photo];
    const bool sphere = of->generator.camera.lens == CN_LENS_EQUIRECTANGULAR;
    for (uint32_t i = photo; i-- > 0;)
        if (same_rays(&s->photos[i], of)) return p->record[i].directions;
    return add(p, photo, DIRECTIONS,
               3 * sizeof(float) * pixels_of(of) + (sphere ? of->size.height * sizeof(uint32_t) : 0));
}

/* Before stereo has run, its maps count with the most that they may have. */
static void add_depths(cn_train_photos *p, const cn_sampler *s, uint32_t photo, bool stereo)
{
    const cn_train_photo *of = &s->photos[photo];
    cn_step_photo *r = &p->record[photo];
    if (s->stereo) {
        const cn_stereo_map *map = &s->stereo[photo];
        r->depth_width = map->depth_m ? map->width : 0;
        r->depth_height = map->depth_m ? map->height : 0;
    } else if (stereo) {
        const cn_stereo_options options = cn_stereo_options_default();
        cn_stereo_size(&options, of->size.width, of->size.height, &r->depth_width, &r->depth_height);
    } else {
        const bool has = cn_pixel_store_has_depth(s->pixels, of->store);
        r->depth_width = has ? of->size.width : 0;
        r->depth_height = has ? of->size.height : 0;
    }
    const uint64_t n = (uint64_t)r->depth_width * r->depth_height;
    if (n) r->depths = add(p, photo, stereo ? STEREO : DEPTHS, n * sizeof(float));
}

void cn_train_photos_list(cn_train_photos *p, const cn_sampler *s, const cn_train_photos_wants *wants)
{
    p->n = 0;
    for (uint32_t i = 0; i < s->n_photos; i++) {
        const cn_train_photo *of = &s->photos[i];
        cn_step_photo *r = &p->record[i];
        *r = (cn_step_photo){ .width = of->size.width,
                              .height = of->size.height,
                              .sphere = of->generator.camera.lens == CN_LENS_EQUIRECTANGULAR,
                              .depths = CN_STEP_NO_MAP,
                              .normals = CN_STEP_NO_MAP,
                              .depth_scale = of->depth_scale,
                              .depth_shift = of->depth_shift };
        for (int k = 0; k < 9; k++)
            r->world_from_cam[k] = (float)of->generator.world_from_cam[k];
        for (int a = 0; a < 3; a++)
            r->origin[a] = (float)(of->generator.origin[a] * of->generator.inv_extent[a]);
        r->pixels = add(p, i, PIXELS, 4 * sizeof(uint16_t) * pixels_of(of));
        r->directions = directions_of(p, s, i);
        if (wants->depths || wants->stereo) add_depths(p, s, i, !wants->depths);
        if (wants->normals && cn_pixel_store_has_normal(s->pixels, of->store))
            r->normals = add(p, i, NORMALS, 4 * pixels_of(of));
    }
}

cn_train_photos_wants cn_train_photos_wanted(const cn_train_options *options, const cn_effect_pack *pack)
{
    return (cn_train_photos_wants){ options->depth_maps, pack->wants_stereo, options->normal_maps };
}

/* ---- the maps ---- */

typedef struct table {
    const cn_camera *camera;
    uint32_t width;
    float *to;
} table;

static void direction_row(void *user, size_t y, unsigned worker)
{
    (void)worker;
    const table *t = user;
    float *to = t->to + 3 * y * t->width;
    for (uint32_t x = 0; x < t->width; x++) {
        double dir[3];
        const bool has = cn_camera_unproject(t->camera, x + 0.5, (double)y + 0.5, dir) == CN_OK;
        for (int a = 0; a < 3; a++)
            *to++ = has ? (float)dir[a] : 0;
    }
}

/* For each row of a photo of all directions the least number of 24 bits that draws it or a row below. */
static void find_row_bounds(uint32_t height, uint32_t *bound)
{
    for (uint32_t row = 0; row < height; row++) {
        uint32_t low = 0, high = 1u << 24;
        while (low < high) {
            const uint32_t middle = (low + high) / 2;
            if (cn_sampler_sphere_row((float)middle * 0x1p-24f, height) >= row)
                high = middle;
            else
                low = middle + 1;
        }
        bound[row] = low;
    }
}

static void make_directions(const cn_context *ctx, const cn_train_photo *of, void *to)
{
    table t = { &of->generator.camera, of->size.width, to };
    cn_pool_run(ctx->pool, of->size.height, direction_row, &t);
    if (of->generator.camera.lens == CN_LENS_EQUIRECTANGULAR)
        find_row_bounds(of->size.height, (uint32_t *)to + 3 * pixels_of(of));
}

static cn_status read_pixels(const cn_sampler *s, const cn_train_photo *of, uint16_t *half)
{
    CN_TRY(cn_store_read_colours(s->pixels, of->store, half));
    if (cn_vignetting_is_none(&of->vignetting)) return CN_OK;
    for (uint32_t y = 0; y < of->size.height; y++)
        for (uint32_t x = 0; x < of->size.width; x++) {
            uint16_t *pixel = half + 4 * ((size_t)y * of->size.width + x);
            float rgb[3];
            for (int c = 0; c < 3; c++)
                rgb[c] = cn_half_to_float(pixel[c]);
            cn_vignetting_remove(&of->vignetting, of->size, x, y, rgb);
            for (int c = 0; c < 3; c++)
                pixel[c] = cn_half_from_float(rgb[c]);
        }
    return CN_OK;
}

cn_status cn_train_photos_read(const cn_train_photos *p, const cn_sampler *s, const cn_context *ctx, uint32_t map,
                               void *to)
{
    const cn_train_map *m = &p->map[map];
    const cn_train_photo *of = &s->photos[m->photo];
    cn_status status = CN_OK;
    switch (m->kind) {
    case PIXELS: status = read_pixels(s, of, to); break;
    case DIRECTIONS: make_directions(ctx, of, to); break;
    case DEPTHS: status = cn_store_read_depths(s->pixels, of->store, to); break;
    case STEREO: memcpy(to, s->stereo[m->photo].depth_m, (size_t)p->bytes[map]); break;
    case NORMALS: status = cn_store_read_normals(s->pixels, of->store, to); break;
    default: break;
    }
    return status == CN_OK ? CN_OK : cn_sampler_unreadable(status);
}
