/* Distillation: a field learns from a trained tile, the teacher, before it learns from the photos (Hinton et al. 2015;
 * for radiance fields Reiser et al. 2021). Places are the samples of the photos' rays, at random in the cells that the
 * teacher has occupied. Private to train/. */
#ifndef CONURB_TRAIN_DISTIL_H
#define CONURB_TRAIN_DISTIL_H
#include "conurb/train.h"
#include "field/occupancy.h"
#include "train/effects.h"
#include "train/worker.h"

typedef struct cn_distil {
    cn_tile *teacher; /* NULL: there is none */
    double until;     /* part of the schedule that learns from it */
    cn_arena memory;
    cn_field_acts *acts; /* [workers] the teacher's */
} cn_distil;

/* The share of the schedule that a field with these settings learns from a teacher; 0: none. */
double cn_distil_share(const cn_field_options *field);
/* Whether a teacher is trained first, and its options. */
bool cn_distil_makes_teacher(const cn_train_options *options);
cn_train_options cn_distil_teacher(const cn_train_options *options);
/* Opens the teacher that options->teacher names, if the field learns from one. Errors as in cn_tile_open. */
CN_NODISCARD cn_status cn_distil_open(cn_distil *distil, const cn_train_options *options, const char *tile,
                                      unsigned workers);
void cn_distil_close(cn_distil *distil);
/* Takes over the teacher's effects, with the rows of the photos, and its occupied cells. CN_ERR_CONFIG: the teacher was
 * trained with other bounds, photos or effects. */
CN_NODISCARD cn_status cn_distil_begin(const cn_distil *distil, const cn_train_input *input, const cn_box *box,
                                       const cn_train_effects *effects, cn_parameters *parameters);
void cn_distil_occupy(const cn_distil *distil, cn_occupancy *occ, uint8_t *usable);
static inline bool cn_distil_is_on(const cn_distil *distil, double progress)
{
    return distil->teacher && progress < distil->until;
}
/* Optical densities of the teacher at n_panels panels of places, as logits of an exponential density. */
void cn_distil_logits(const cn_distil *distil, const cn_kernel *kernel, unsigned worker, const float *pos,
                      size_t n_panels, float *logit);
/* Colours of the teacher, before cn_field_light, at n places; their conditioning is a row for each ray. Returns
 * out[n_panels][4][CN_PANEL], until the worker's next call. */
const float *cn_distil_colours(const cn_distil *distil, const cn_kernel *kernel, unsigned worker, const float *pos,
                               uint32_t n, const cn_worker *of);
/* From the differences between field and teacher to the gradients of n live samples: of->d_logit and of->d.out. The
 * worker holds what the field gives (acts) and the teacher's logits of all samples; length: of all samples. out: of
 * cn_distil_colours. scale: of a ray's loss. */
void cn_distil_compare(const cn_field *field, const cn_worker *of, uint32_t n, const float *length, const float *out,
                       float scale);
#endif
