#include "train/effects.h"

#include "effect/pose.h"
#include "effect/runs.h"

cn_status cn_train_effects_size(cn_train_effects *e, const cn_plan_tile *tile)
{
    const char *names[CN_MAX_EFFECTS];
    uint32_t n = 0;
    for (uint32_t i = 0; i < tile->n_effects; i++)
        if (tile->effects[i].on) names[n++] = tile->effects[i].name;
    e->n_photos = tile->n_photos;
    return cn_effect_pack_make(&e->pack, n, names, e->n_photos);
}

void cn_train_effects_carve(cn_train_effects *e, cn_arena *arena)
{
    e->constants = CN_ARENA_NEW(arena, float, e->pack.n_constants);
    e->run = e->pack.wants_runs ? CN_ARENA_NEW(arena, float, e->n_photos) : NULL;
    e->trend = e->pack.moves_rays ? cn_arena_take(arena, e->n_photos, sizeof *e->trend) : NULL;
    e->derived = CN_ARENA_NEW(arena, float, e->pack.n_shared);
}

static const cn_photo *photo_of(const cn_train_input *input, uint32_t view)
{
    return &input->photos->photos[input->scene->views[view].photo];
}

void cn_train_constants(const cn_train_input *input, const cn_effect_pack *pack, float *constants)
{
    const cn_plan_tile *tile = input->tile;
    for (uint32_t e = 0; e < pack->n_on; e++) {
        const cn_effect *effect = pack->on[e].effect;
        const uint32_t width = effect->photo_constants;
        if (!width) continue;
        const cn_effect_settings told = cn_effect_settings_told(input->photos, input->scene, tile);
        float *rows = constants + pack->on[e].constants;
        for (uint32_t i = 0; i < pack->n_rows; i++) {
            const uint32_t view = i < tile->n_photos ? tile->photos[i] : tile->held_out[i - tile->n_photos];
            effect->constants(photo_of(input, view), told, rows + (size_t)i * width);
        }
    }
    cn_effects_centre(pack, tile->n_photos, constants);
}

static void find_runs(cn_train_effects *e, const cn_train_input *input)
{
    for (uint32_t i = 0; i < e->n_photos; i++)
        e->run[i] = cn_run_time(photo_of(input, input->tile->photos[i]));
    (void)cn_runs_find(e->run, 1, e->n_photos);
}

void cn_train_effects_begin(cn_train_effects *e, const cn_train_input *input, const cn_sampler *sampler,
                            float inv_extent, uint64_t seed, cn_parameters *p)
{
    cn_train_constants(input, &e->pack, e->constants);
    if (e->run) find_runs(e, input);
    for (uint32_t i = 0; e->trend && i < e->n_photos; i++)
        for (int a = 0; a < 3; a++)
            e->trend[i][a] = (float)sampler->photos[i].generator.origin[a] * inv_extent;
    if (e->trend) cn_pose_trends(e->n_photos, (const float(*)[3])e->trend, e->trend);
    cn_effects_init(&e->pack, seed, p->value + p->shared_at);
    cn_train_effects_derive(e, p);
}

void cn_train_effects_derive(const cn_train_effects *e, const cn_parameters *p)
{
    cn_effects_derive(&e->pack, p->value + p->shared_at, e->derived);
}

void cn_train_effects_project(const cn_train_effects *e, cn_parameters *p, double progress)
{
    const cn_effect_photos photos = { e->n_photos, e->constants, e->run, (const float(*)[3])e->trend };
    cn_effects_project(&e->pack, &photos, p->value + p->photo_at, progress);
    cn_train_effects_derive(e, p);
}

cn_effect_state cn_train_effects_state(const cn_train_effects *e, const cn_kernel *kernel, const cn_parameters *p)
{
    return (cn_effect_state){ kernel, e->constants, p->value + p->photo_at, p->value + p->shared_at, e->derived };
}

cn_effect_rays cn_train_effects_rays(const cn_batch *b, uint32_t group)
{
    const size_t first = (size_t)group * CN_GROUP;
    return (cn_effect_rays){ CN_GROUP, b->dirs + 3 * first, b->uv ? b->uv + 2 * first : NULL, b->ray_photo + first,
                             b->sky_hint ? b->sky_hint + first : NULL };
}

/* Converts between box units and units of the mean half extent. */
void cn_train_effects_move(const cn_train_effects *e, const cn_effect_state *state, const cn_box *box, uint32_t group,
                           cn_batch *b)
{
    const cn_box_units units = cn_box_units_of(box);
    float origin[CN_GROUP][3], dir[CN_GROUP][3];
    cn_ray *ray = b->rays + (size_t)group * CN_GROUP;
    const cn_effect_rays rays = cn_train_effects_rays(b, group);
    for (uint32_t i = 0; i < CN_GROUP; i++)
        for (int a = 0; a < 3; a++) {
            origin[i][a] = ray[i].box_ray.origin[a] * units.to_mean[a];
            dir[i][a] = ray[i].dir[a];
        }
    cn_effects_ray(&e->pack, &rays, state, origin, dir);
    for (uint32_t i = 0; i < CN_GROUP; i++)
        for (int a = 0; a < 3; a++) {
            ray[i].box_ray.origin[a] = origin[i][a] * units.from_mean[a];
            ray[i].box_ray.dir[a] = dir[i][a] * units.from_m[a];
        }
}

void cn_train_effects_list(const cn_train_effects *e, cn_checkpoint *c)
{
    cn_checkpoint_add(c, "constants", CN_F32, e->pack.n_constants, e->constants);
}
