#include "train/batch.h"

#include "field/occupancy.h"

#include <string.h>

void cn_batch_size(cn_batch *b, uint32_t samples_per_step, uint32_t enc_rows)
{
    b->panel_cap = samples_per_step / CN_PANEL * 5 / 4 + CN_MAX_GROUPS;
    b->enc_rows = enc_rows;
}

void cn_batch_carve(cn_batch *b, cn_arena *arena, cn_batch_wants wants)
{
    const size_t lanes = b->panel_cap * CN_PANEL;
    b->rays = CN_ARENA_NEW(arena, cn_ray, CN_MAX_RAYS);
    b->dirs = CN_ARENA_NEW(arena, float, 3 * CN_MAX_RAYS);
    b->uv = wants.uv ? CN_ARENA_NEW(arena, float, 2 * CN_MAX_RAYS) : NULL;
    b->sky_hint = wants.sky_hint ? CN_ARENA_NEW(arena, uint8_t, CN_MAX_RAYS) : NULL;
    b->ray_photo = CN_ARENA_NEW(arena, uint32_t, CN_MAX_RAYS);
    b->ray_samples = CN_ARENA_NEW(arena, uint32_t, CN_MAX_RAYS);
    b->target = CN_ARENA_NEW(arena, float, 4 * CN_MAX_RAYS);
    b->depth_m = CN_ARENA_NEW(arena, float, CN_MAX_RAYS);
    b->measured_m = wants.measured ? CN_ARENA_NEW(arena, float, CN_MAX_RAYS) : NULL;
    b->plane_log = wants.planes ? CN_ARENA_NEW(arena, float, CN_MAX_RAYS) : NULL;
    b->plane_width = wants.planes ? CN_ARENA_NEW(arena, float, CN_MAX_RAYS) : NULL;
    b->first_t = CN_ARENA_NEW(arena, float, CN_MAX_RAYS);
    b->counts = CN_ARENA_NEW(arena, cn_step_counts, 1);
    b->march_t = CN_ARENA_NEW(arena, float, (size_t)CN_MAX_GROUPS *CN_GROUP_CAP);
    b->group_samples = CN_ARENA_NEW(arena, uint32_t, CN_MAX_GROUPS);
    b->group_live = CN_ARENA_NEW(arena, uint32_t, CN_MAX_GROUPS);
    b->group_panel = CN_ARENA_NEW(arena, size_t, CN_MAX_GROUPS);
    b->pos = CN_ARENA_NEW(arena, float, 3 * lanes);
    b->enc = CN_ARENA_NEW(arena, float, b->enc_rows *lanes);
    b->length = CN_ARENA_NEW(arena, float, lanes);
    b->visit_cell = CN_ARENA_NEW(arena, uint32_t, lanes);
    b->visit_seen = CN_ARENA_NEW(arena, float, lanes);
}

void cn_batch_note_dirs(cn_batch *b, uint32_t group)
{
    for (uint32_t r = group * CN_GROUP; r < (group + 1) * CN_GROUP; r++)
        memcpy(b->dirs + 3 * (size_t)r, b->rays[r].dir, sizeof b->rays[r].dir);
}

uint32_t cn_batch_march_ray(cn_batch *b, uint32_t r, const cn_batch_march *m, float *at, uint32_t room)
{
    const cn_march march = { b->first_t[r], m->box->far_m, (float)(1 + m->step), 0 };
    const uint32_t n = m->kernel->march(&b->rays[r].box_ray, &march, m->occupied, at, room);
    if (n < room) return n;
    b->target[4 * (size_t)r + 3] = 0;
    return 0;
}

void cn_batch_lay_out(cn_batch *b)
{
    size_t panels = 0;
    cn_step_counts *counts = b->counts;
    *counts = (cn_step_counts){ 0 };
    for (uint32_t g = 0; g < b->n_groups; g++) {
        const size_t wanted = cn_batch_panels(b->group_samples[g]);
        const bool fits = panels + wanted <= b->panel_cap;
        b->group_panel[g] = fits ? panels : SIZE_MAX;
        b->group_live[g] = 0;
        if (!fits) continue;
        panels += wanted;
        counts->samples += b->group_samples[g];
        for (uint32_t i = g * CN_GROUP; i < (g + 1) * CN_GROUP; i++) {
            counts->kept_rays += b->target[4 * (size_t)i + 3] > 0;
            counts->marched_rays += b->ray_samples[i] > 0;
        }
    }
    counts->n_panels = (uint32_t)panels;
}

void cn_batch_place(cn_batch *b, const cn_kernel *kernel, float march_step, float inv_extent, uint32_t g)
{
    const size_t panels = cn_batch_panels(b->group_samples[g]);
    float *pos = b->pos + b->group_panel[g] * 3 * CN_PANEL, *length = b->length + b->group_panel[g] * CN_PANEL;
    if (panels) memset(pos + (panels - 1) * 3 * CN_PANEL, 0, 3 * CN_PANEL * sizeof *pos);
    const float *at = b->march_t + (size_t)g * CN_GROUP_CAP;
    uint32_t done = 0;
    for (uint32_t i = 0; i < CN_GROUP; i++) {
        const uint32_t r = g * CN_GROUP + i;
        kernel->place(&b->rays[r].box_ray, at + done, b->ray_samples[r], (cn_spacing){ march_step, inv_extent },
                      (cn_lanes){ pos, done }, length + done);
        done += b->ray_samples[r];
    }
}

void cn_batch_note_cells(cn_batch *b, uint32_t group)
{
    const size_t first = b->group_panel[group] * CN_PANEL;
    for (uint32_t i = 0; i < b->group_samples[group]; i++) {
        const float *pos = b->pos + (first + i) / CN_PANEL * (3 * CN_PANEL) + (first + i) % CN_PANEL;
        b->visit_cell[first + i] = cn_occupancy_cell(pos[0], pos[CN_PANEL], pos[2 * CN_PANEL]);
    }
}
