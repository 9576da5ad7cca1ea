#include "appearance/lens.h"

#include "tile/model.h"

cn_status cn_lens_vignetting(const cn_dataset *m, const cn_tile *tile, const cn_view *view, cn_vignetting *v)
{
    *v = (cn_vignetting){ 0 };
    const int64_t which = cn_plan_find(&m->plan, cn_tile_id(tile));
    if (!tile->pack.wants_vignetting || which < 0 || !m->pixels) return CN_OK;
    const cn_plan_input input = { &m->scene, &m->photos, &m->frame, m->pixels };
    const uint32_t index = (uint32_t)(view - m->scene.views);
    const cn_status status = cn_vignetting_find(&input, &m->plan.tiles[which], 1, &index, v);
    return status == CN_ERR_DATA ? CN_OK : status;
}
