#include "train/worker.h"

void cn_worker_carve(const cn_field *field, const cn_effect_pack *pack, cn_arena *arena, cn_worker *w)
{
    const size_t panels = CN_GROUP_CAP / CN_PANEL, cap = CN_GROUP_CAP;
    field->type->acts_take(field, arena, panels, &w->acts);
    field->type->acts_take(field, arena, panels, &w->d);
    w->logit = CN_ARENA_NEW(arena, float, cap);
    w->d_logit = CN_ARENA_NEW(arena, float, cap);
    w->weight = CN_ARENA_NEW(arena, float, cap);
    w->behind = CN_ARENA_NEW(arena, float, cap);
    w->tau_gradient = CN_ARENA_NEW(arena, float, cap);
    w->d_weight = CN_ARENA_NEW(arena, float, cap);
    w->d_colour = CN_ARENA_NEW(arena, float, 3 * cap);
    w->log_distance = CN_ARENA_NEW(arena, float, cap);
    w->single_view = pack->wants_support ? CN_ARENA_NEW(arena, uint8_t, cap) : NULL;
    w->live = CN_ARENA_NEW(arena, uint32_t, cap);
    w->live_ray = CN_ARENA_NEW(arena, uint32_t, cap);
    w->colour = CN_ARENA_NEW(arena, float, 3 * cap);
    w->conditioning = CN_ARENA_NEW(arena, float, (size_t)CN_GROUP * field->conditioning);
    w->d_conditioning = CN_ARENA_NEW(arena, float, (size_t)CN_GROUP * field->conditioning);
    w->saved = CN_ARENA_NEW(arena, float, pack->saved *CN_EFFECT_RAYS);
    w->d_pos = pack->moves_rays ? cn_arena_take(arena, cap, sizeof *w->d_pos) : NULL;
}
