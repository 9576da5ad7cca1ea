#include "train/sampler.h"

#include "base/rng.h"
#include "base/units.h"
#include "effect/sky_hints.h"
#include "math/linalg.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Random streams; 1 to 6 belong to the field. */
enum { STREAM_PHOTO = 16, STREAM_X, STREAM_Y, STREAM_JITTER };

/* Mean number of samples that a ray may have. The march's step is as short as this allows, but not shorter than the
 * tile's own. At first space is full of fog, so steps are long and rays many. As space empties, the same number of
 * samples follows the surfaces. At the end a ray may have more, because depth is only as exact as the march. Tuned
 * on the synthetic city with wide streets. There 20 samples meant a step of 1.75 % of the distance. Steps of 0.8 %
 * in the last part bring the median error of depth from 1.2 to 0.9 % and gain 0.4 dB, in the same time. */
#define SAMPLES_PER_RAY 20.0
#define LAST_SAMPLES_PER_RAY 64.0
/* Where the march's steps are as short as they can be, and a ray has less than this share of the samples that it may
 * have, there is room for samples that look into empty space. Not measured apart. */
#define FEW_SAMPLES 0.75
/* Where poses are refined, a ray may have so many samples from the start, and sparse depth samples are drawn in this
 * part of the schedule only. Tuned on the synthetic city with poses off by 0.5 degrees and 15 cm: before, cameras
 * ended more than 10 cm off; now 6.6 cm. */
#define MOVED_SAMPLES_PER_RAY 40.0
#define SPARSE_WHERE_RAYS_MOVE 0.1
/* What is known of the photos leads a schedule of so many steps to its end, one of four times as many in its first
 * half. Sparse points clear the space before walls of fog, without which 4 dB are lost on a synthetic city at standard.
 * Later they take rays from the photos and hold thin things back (ended at 0.4 of standard: a synthetic city gains 0.2
 * dB, herz-jesus 0.3), but make depth exact. In every fourth, second and single step then, the median error of depth of
 * a synthetic city of 224 photos in four lights is 0.73, 0.69 and 0.66 %; in every single one castle loses 0.2 dB, in
 * every second one no set that was tried does. Where a photo shows no sky is known in cells only, and not between
 * twigs. Matter that this asks for all through a schedule costs that city 0.7 dB of its training PSNR.
 * tests/bench/experiments.md has the other sets. */
#define LEAD_STEPS 1500.0
#define SPARSE_EVERY_STEPS 2
/* From this fraction on the sky also learns where photos show none (sky_hints.h). Found on castle: 0.93 closes one more
 * hole in a wall and loses 0.2 to 0.7 dB, 1 leaves bright slits where rays pass between cells. */
#define LAST 0.85

void cn_sampler_carve(cn_sampler *s, cn_arena *arena, bool wants_sky_hints)
{
    s->sky_hint = wants_sky_hints ? CN_ARENA_NEW(arena, uint8_t, (size_t)s->n_photos * CN_SKY_HINTS) : NULL;
    s->photos = CN_ARENA_NEW(arena, cn_train_photo, s->n_photos);
    s->sparse = CN_ARENA_NEW(arena, cn_sparse_sample, CN_MAX_SPARSE);
}

cn_status cn_sampler_find_photos(cn_sampler *s, const cn_train_input *input, const cn_box *box)
{
    const cn_scene *scene = input->scene;
    s->pixels = input->pixels;
    s->near_m = box->near_m;
    for (uint32_t i = 0; i < s->n_photos; i++) {
        const cn_view *view = &scene->views[input->tile->photos[i]];
        if (view->photo >= cn_pixel_store_count(input->pixels))
            return cn_fail(CN_ERR_DATA, "photo %s is not in the pixel store; run `conurb plan` again", view->name);
        cn_train_photo *p = &s->photos[i];
        p->store = view->photo;
        p->vignetting = (cn_vignetting){ 0 };
        p->size = cn_pixel_store_extent(input->pixels, view->photo);
        cn_camera camera;
        cn_camera_resize(&scene->cameras[view->camera], p->size.width, p->size.height, &camera);
        cn_ray_generator_init(&p->generator, &camera, view, box);
    }
    return CN_OK;
}

static bool sparse_sample(const cn_scene *scene, const cn_point *point, const cn_observation *o, cn_pixel_extent size,
                          cn_sparse_sample *sample)
{
    const cn_view *view = &scene->views[o->view];
    const cn_camera *camera = &scene->cameras[view->camera];
    const double x = (double)o->x_px * size.width / camera->width, y = (double)o->y_px * size.height / camera->height;
    if (!(x >= 0 && y >= 0 && x < size.width && y < size.height)) return false;
    double centre[3], squared = 0;
    cn_view_centre(view, centre);
    for (int a = 0; a < 3; a++)
        squared += (point->xyz[a] - centre[a]) * (point->xyz[a] - centre[a]);
    *sample = (cn_sparse_sample){ 0, (uint16_t)x, (uint16_t)y, (float)sqrt(squared) };
    return true;
}

/* Takes the sparse points that training photos see, evenly thinned to the room there is. */
static cn_status find_sparse(cn_sampler *s, const cn_train_input *input, const cn_box *box)
{
    const cn_scene *scene = input->scene;
    uint32_t *row = malloc(sizeof *row * (scene->n_views + 1u));
    if (!row) return cn_fail(CN_ERR_NOMEM, "out of memory at the start of tile %s", input->tile->id);
    memset(row, 0xff, sizeof *row * scene->n_views);
    for (uint32_t i = 0; i < s->n_photos; i++)
        row[input->tile->photos[i]] = i;
    uint64_t seen = 0, n = 0;
    for (uint64_t i = 0; i < scene->n_observations; i++)
        n += row[scene->observations[i].view] != UINT32_MAX;
    const uint64_t stride = n / CN_MAX_SPARSE + 1;
    s->n_sparse = 0;
    for (uint32_t p = 0; p < scene->n_points; p++)
        for (uint32_t k = 0; k < scene->points[p].n_observations; k++) {
            const cn_observation *o = &scene->observations[scene->points[p].first_observation + k];
            const uint32_t photo = row[o->view];
            if (photo == UINT32_MAX || seen++ % stride || s->n_sparse == CN_MAX_SPARSE) continue;
            cn_sparse_sample sample;
            if (!sparse_sample(scene, &scene->points[p], o, s->photos[photo].size, &sample)) continue;
            sample.photo = photo;
            if (sample.distance_m > box->near_m && sample.distance_m < box->far_m) s->sparse[s->n_sparse++] = sample;
        }
    free(row);
    return CN_OK;
}

cn_status cn_sampler_begin(cn_sampler *s, const cn_train_input *input, const cn_box *box)
{
    CN_TRY(cn_sampler_find_photos(s, input, box));
    CN_TRY(find_sparse(s, input, box));
    const cn_plan_input seen = { input->scene, input->photos, NULL, input->pixels };
    if (s->sky_hint && !cn_sky_hints_find(&seen, input->tile, s->sky_hint))
        return cn_fail(CN_ERR_NOMEM, "out of memory at the start of tile %s", input->tile->id);
    s->pace = (cn_pace){ CN_GROUP_CAP, CN_LONGEST_STEP };
    return CN_OK;
}

cn_status cn_sampler_find_vignetting(cn_sampler *s, const cn_train_input *input)
{
    cn_vignetting *of = malloc((s->n_photos + 1u) * sizeof *of);
    if (!of) return cn_fail(CN_ERR_NOMEM, "out of memory at the start of tile %s", input->tile->id);
    const cn_plan_input seen = { input->scene, input->photos, NULL, input->pixels };
    const cn_status status = cn_vignetting_find(&seen, input->tile, s->n_photos, input->tile->photos, of);
    for (uint32_t i = 0; status == CN_OK && i < s->n_photos; i++)
        s->photos[i].vignetting = of[i];
    free(of);
    /* Too few tracked points, though the effect is on by city.yaml: then there is none. */
    return status == CN_ERR_DATA ? CN_OK : status;
}

/* A place that only one photo shows may hold matter where it is farther from the photo than this part of the
 * distance of the photo's nearest sparse points. Without such places, the field explains what one photo shows by
 * matter elsewhere: blocks float in front of walls, and holes look like cells. With places nearer to the camera it
 * would build fog. Tuned on two sets of ten and eleven photos of a facade and a fountain, on brighton and herz-jesus:
 * 0.6 to 2 dB on held-out photos. castle, fox and lund do not change. */
#define ALONE_FROM 0.7
#define NEAREST_PART 20 /* a photo's nearest twentieth of sparse points: nearer ones may be wrong */
/* In a part of the picture whose surroundings have so many points, these count in place of the photo's, if they are
 * farther away. Otherwise the ends of photos from the air hang in the sky of the film of `scripts/run`. */
#define LOCAL_POINTS 10

static int by_photo(const void *a, const void *b)
{
    const cn_sparse_sample *x = a, *y = b;
    return (x->photo > y->photo) - (x->photo < y->photo);
}

/* The samples of one photo; size: of its picture. */
typedef struct photo_samples {
    const cn_sparse_sample *of;
    uint32_t n;
    cn_pixel_extent size;
} photo_samples;

/* From where on one photo is enough, by the samples of the part of the picture and of those around it; 0: too few. All
 * samples count with part -1. room: for all of them. */
static double alone_from(const photo_samples *samples, int part, double *room)
{
    size_t n = 0;
    for (uint32_t i = 0; i < samples->n; i++) {
        const cn_sparse_sample *sample = &samples->of[i];
        const int x = sample->x * CN_ALONE_X / (int)samples->size.width,
                  y = sample->y * CN_ALONE_Y / (int)samples->size.height;
        if (part < 0 || (abs(x - part % CN_ALONE_X) <= 1 && abs(y - part / CN_ALONE_X) <= 1))
            room[n++] = (double)sample->distance_m;
    }
    return n && (part < 0 || n >= LOCAL_POINTS) ? ALONE_FROM * cn_select(room, n, n / NEAREST_PART) : 0;
}

/* alone_from_m[photo][part]; INFINITY for a photo without sparse points. sorted, room: for all sparse samples. */
static void find_alone_from(const cn_sampler *s, cn_sparse_sample *sorted, double *room, float *alone_from_m)
{
    for (uint32_t i = 0; i < s->n_photos * CN_ALONE_PARTS; i++)
        alone_from_m[i] = INFINITY;
    memcpy(sorted, s->sparse, sizeof *sorted * s->n_sparse);
    qsort(sorted, s->n_sparse, sizeof *sorted, by_photo);
    for (uint32_t i = 0, end; i < s->n_sparse; i = end) {
        const uint32_t photo = sorted[i].photo;
        for (end = i + 1; end < s->n_sparse && sorted[end].photo == photo;)
            end++;
        const photo_samples samples = { sorted + i, end - i, s->photos[photo].size };
        const double all = alone_from(&samples, -1, room);
        for (int part = 0; part < CN_ALONE_PARTS; part++)
            alone_from_m[(size_t)photo * CN_ALONE_PARTS + (size_t)part] =
                (float)fmax(all, alone_from(&samples, part, room));
    }
}

/* Copies the generators, because the record of a photo holds more than its generator. */
cn_status cn_sampler_usable_cells(const cn_sampler *s, cn_pool *pool, const cn_box *box, uint8_t *usable)
{
    cn_ray_generator *generators = malloc(sizeof *generators * (s->n_photos + 1u));
    cn_sparse_sample *sorted = malloc(sizeof *sorted * (s->n_sparse + 1u));
    double *distances = malloc(sizeof *distances * (s->n_sparse + 1u));
    float *alone_from_m = malloc(sizeof *alone_from_m * (s->n_photos + 1u) * CN_ALONE_PARTS);
    bool room = generators && sorted && distances && alone_from_m;
    if (room) {
        for (uint32_t i = 0; i < s->n_photos; i++)
            generators[i] = s->photos[i].generator;
        find_alone_from(s, sorted, distances, alone_from_m);
        room = cn_rays_visible_cells(pool, box, &(cn_seeing_views){ s->n_photos, generators, alone_from_m }, usable);
    }
    free(generators);
    free(sorted);
    free(distances);
    free(alone_from_m);
    return room ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory at the start of training");
}

double cn_lead_end(uint32_t steps)
{
    return sqrt(LEAD_STEPS / fmax(steps, LEAD_STEPS));
}

cn_lead cn_sampler_lead(const cn_sampler *s, cn_step_at at, bool moves_rays)
{
    const double progress = cn_step_progress(at);
    const bool early = !(progress >= cn_lead_end(at.steps)),
               sparse = moves_rays ? !(progress >= SPARSE_WHERE_RAYS_MOVE) : early || at.step % SPARSE_EVERY_STEPS == 0;
    const cn_sky_hint no_sky = progress >= LAST ? CN_SKY_NONE_LAST : early ? CN_SKY_NONE : CN_SKY_NONE_LATE;
    return (cn_lead){ .sparse = s->n_sparse && sparse, .no_sky = (uint8_t)no_sky };
}

/* Rows near the poles of an equirectangular photo show little of the sphere. */
uint32_t cn_sampler_sphere_row(float drawn, uint32_t height)
{
    const double sine = 2.0 * (double)drawn - 1.0;
    const uint32_t row = (uint32_t)((asin(sine) / CN_PI + 0.5) * height);
    return row < height ? row : height - 1;
}

static uint32_t draw_row(const cn_sampler *s, uint64_t counter, const cn_train_photo *p)
{
    const uint32_t height = p->size.height;
    if (p->generator.camera.lens != CN_LENS_EQUIRECTANGULAR) return cn_rng_below(s->seed, STREAM_Y, counter, height);
    return cn_sampler_sphere_row(cn_rng_float(s->seed, STREAM_Y, counter), height);
}

static void draw_pixel(const cn_sampler *s, uint32_t step, cn_lead lead, uint32_t r, cn_batch *b, uint16_t at[2])
{
    const uint64_t counter = (uint64_t)step * CN_MAX_RAYS + r;
    b->depth_m[r] = 0;
    if (lead.sparse && r % CN_SPARSE_EVERY == 0) {
        const cn_sparse_sample *sample = &s->sparse[cn_rng_below(s->seed, STREAM_PHOTO, counter, s->n_sparse)];
        at[0] = sample->x;
        at[1] = sample->y;
        b->ray_photo[r] = sample->photo;
        b->depth_m[r] = sample->distance_m;
        return;
    }
    const uint32_t photo = cn_rng_below(s->seed, STREAM_PHOTO, counter, s->n_photos);
    const cn_train_photo *p = &s->photos[photo];
    at[0] = (uint16_t)cn_rng_below(s->seed, STREAM_X, counter, p->size.width);
    at[1] = (uint16_t)draw_row(s, counter, p);
    b->ray_photo[r] = photo;
}

static void note_sky_hint(const cn_sampler *s, cn_lead lead, cn_batch *b, uint32_t r, const uint16_t at[2])
{
    const cn_pixel_extent size = s->photos[b->ray_photo[r]].size;
    const uint32_t x = (uint32_t)at[0] * CN_SKY_HINT_X / size.width, y = (uint32_t)at[1] * CN_SKY_HINT_Y / size.height;
    const uint8_t hint = s->sky_hint[(size_t)b->ray_photo[r] * CN_SKY_HINTS + y * CN_SKY_HINT_X + x];
    b->sky_hint[r] = hint == CN_SKY_NONE ? lead.no_sky : hint;
}

static void note_uv(const cn_sampler *s, cn_batch *b, uint32_t r, const uint16_t at[2])
{
    const cn_pixel_extent size = s->photos[b->ray_photo[r]].size;
    b->uv[2 * (size_t)r] = 2 * ((float)at[0] + 0.5f) / (float)size.width - 1;
    b->uv[2 * (size_t)r + 1] = 2 * ((float)at[1] + 0.5f) / (float)size.height - 1;
}

/* A random part of a step before the first sample. Two rays on one plane begin alike, so that the march's steps do not
 * tilt the plane. */
static void begin_march(const cn_sampler *s, uint32_t step, uint32_t r, cn_batch *b)
{
    const bool second = b->plane_width && cn_sampler_is_neighbour(r) && b->plane_width[r] > 0;
    const float jitter = cn_rng_float(s->seed, STREAM_JITTER, (uint64_t)step * CN_MAX_RAYS + (second ? r - 1 : r));
    b->first_t[r] = s->near_m * powf((float)(1 + s->pace.march_step), jitter);
}

void cn_sampler_draw(cn_sampler *s, uint32_t step, cn_lead lead, uint32_t g, cn_batch *b)
{
    uint16_t x[CN_GROUP], y[CN_GROUP];
    uint32_t store[CN_GROUP];
    const uint32_t first = g * CN_GROUP;
    for (uint32_t i = 0; i < CN_GROUP; i++) {
        uint16_t at[2];
        if (b->plane_log && cn_sampler_is_neighbour(i)) memcpy(at, (uint16_t[2]){ x[i - 1], y[i - 1] }, sizeof at);
        if (!(b->plane_log && cn_sampler_is_neighbour(i) && cn_sampler_draw_neighbour(s, step, first + i, b, at)))
            draw_pixel(s, step, lead, first + i, b, at);
        x[i] = at[0];
        y[i] = at[1];
        store[i] = s->photos[b->ray_photo[first + i]].store;
        if (b->uv) note_uv(s, b, first + i, at);
        if (b->sky_hint) note_sky_hint(s, lead, b, first + i, at);
    }
    s->read_status[g] = cn_pixel_store_gather(s->pixels, CN_GROUP, store, x, y, b->target + 4 * (size_t)first);
    for (uint32_t i = 0; i < CN_GROUP; i++) {
        const uint32_t r = first + i;
        const cn_train_photo *photo = &s->photos[b->ray_photo[r]];
        if (!cn_vignetting_is_none(&photo->vignetting))
            cn_vignetting_remove(&photo->vignetting, photo->size, x[i], y[i], b->target + 4 * (size_t)r);
        const cn_ray_generator *generator = &photo->generator;
        if (!(b->target[4 * (size_t)r + 3] > 0) ||
            !cn_ray_generator_ray(generator, x[i] + 0.5, y[i] + 0.5, &b->rays[r])) {
            b->target[4 * (size_t)r + 3] = 0;
            b->rays[r] = (cn_ray){ 0 };
        }
    }
    cn_batch_note_dirs(b, g);
    if (b->measured_m && s->read_status[g] == CN_OK) s->read_status[g] = cn_sampler_read_depth(s, g, x, y, b);
    if (b->plane_log && s->read_status[g] == CN_OK) s->read_status[g] = cn_sampler_read_normals(s, g, x, y, b);
    for (uint32_t r = first; r < first + CN_GROUP; r++)
        begin_march(s, step, r, b);
}

cn_status cn_sampler_unreadable(cn_status status)
{
    return cn_fail(status, "the pixel store cannot be read; delete pixels.bin and run `conurb plan` again");
}

uint32_t cn_sampler_groups(const cn_sampler *s, uint32_t samples_per_step)
{
    return (uint32_t)fmin(fmax(samples_per_step / s->pace.samples_per_group, 4), CN_MAX_GROUPS);
}

void cn_sampler_note_groups(cn_sampler *s, uint64_t samples, uint32_t n_groups)
{
    s->pace.samples_per_group = 0.8 * s->pace.samples_per_group + 0.2 * fmax((double)samples / n_groups, CN_GROUP);
}

static double room_at(cn_step_at at, bool moves_rays)
{
    if (at.step >= CN_RATE_HELD * at.steps) return LAST_SAMPLES_PER_RAY;
    return moves_rays ? MOVED_SAMPLES_PER_RAY : SAMPLES_PER_RAY;
}

bool cn_sampler_has_room(const cn_sampler *s, double samples_per_ray, cn_step_at at, bool moves_rays, double shortest)
{
    return s->pace.march_step <= shortest && samples_per_ray < FEW_SAMPLES * room_at(at, moves_rays);
}

void cn_sampler_adapt_march(cn_sampler *s, double samples_per_ray, cn_step_at at, bool moves_rays, double shortest)
{
    const double change = fmin(fmax(samples_per_ray / room_at(at, moves_rays), 0.98), 1.02);
    s->pace.march_step = fmin(fmax(s->pace.march_step * change, shortest), CN_LONGEST_STEP);
}
