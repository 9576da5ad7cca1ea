/* The list of loss terms. A new term is a file in this folder and a line here. */
#include "loss/loss.h"

#include <string.h>

extern const cn_loss_term cn_loss_colour;
extern const cn_loss_term cn_loss_glow;
extern const cn_loss_term cn_loss_openness;
extern const cn_loss_term cn_loss_ground;
extern const cn_loss_term cn_loss_spread;
extern const cn_loss_term cn_loss_sparse_depth;
extern const cn_loss_term cn_loss_measured_depth;
extern const cn_loss_term cn_loss_depth_cue;
extern const cn_loss_term cn_loss_normal_cue;
extern const cn_loss_term cn_loss_single_view;

const cn_loss_term *const cn_loss_list[] = {
    &cn_loss_colour,       &cn_loss_glow,           &cn_loss_openness,  &cn_loss_ground,     &cn_loss_spread,
    &cn_loss_sparse_depth, &cn_loss_measured_depth, &cn_loss_depth_cue, &cn_loss_normal_cue, &cn_loss_single_view,
};
const uint32_t cn_loss_count = sizeof cn_loss_list / sizeof *cn_loss_list;
_Static_assert(sizeof cn_loss_list / sizeof *cn_loss_list <= CN_MAX_LOSSES, "a pack has room for every term");

void cn_loss_pack_make(cn_loss_pack *pack, const cn_loss_scene *scene)
{
    pack->n = 0;
    for (uint32_t i = 0; i < cn_loss_count; i++)
        if (!cn_loss_list[i]->on || cn_loss_list[i]->on(scene)) pack->term[pack->n++] = cn_loss_list[i];
}

void cn_losses_add(const cn_loss_pack *pack, const cn_loss_ray *ray, cn_loss_grad *grad)
{
    memset(grad->weight, 0, ray->n * sizeof *grad->weight);
    memset(grad->colour, 0, 3 * (size_t)ray->n * sizeof *grad->colour);
    for (uint32_t i = 0; i < pack->n; i++)
        pack->term[i]->add(ray, grad);
}
