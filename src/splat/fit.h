/* Fitting Gaussians to pictures. */
#ifndef CONURB_SPLAT_FIT_H
#define CONURB_SPLAT_FIT_H
#include "splat/seeds.h"

/* Fits the set in place; between rounds Gaussians are removed, and others put up to the set's room. The report's n_*,
 * psnr and fit_s are filled. CN_ERR_NOMEM, CN_ERR_INTERRUPTED. */
CN_NODISCARD cn_status cn_splat_fit(cn_splat_set *set, const cn_context *ctx, const cn_targets *targets,
                                    const cn_splat_options *options, cn_splat_report *report);
#endif
