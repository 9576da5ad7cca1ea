/* Charts of accuracy against time. Private to stage/. */
#ifndef CONURB_STAGE_TRADEOFF_CHART_H
#define CONURB_STAGE_TRADEOFF_CHART_H
#include "conurb/measure.h"

/* Bars of the dB that each effect adds and the seconds that it takes. Row 0 is the plan's choice; each other row has
 * one effect switched and is named with-NAME or without-NAME. */
CN_NODISCARD cn_status cn_tradeoff_draw_effects(const cn_tradeoff *tradeoff, const char *path);
/* Held-out PSNR against time, one chart for training and one for rendering. The Pareto front is drawn, and its dots
 * have names. A dot's area is its memory. */
CN_NODISCARD cn_status cn_tradeoff_draw_front(const cn_tradeoff *tradeoff, const char *path);
/* Sets `why` of each type of field that is far behind the best, by two figures. A type whose training photos are worse
 * has not learned them yet, or is too small for them. A type whose held-out photos fall farther behind its training
 * photos has fitted those alone. */
void cn_tradeoff_say_why(cn_tradeoff *tradeoff);
/* The same for types of field: PSNR and SSIM against the time of training and the size on disk, PSNR against the time
 * of rendering, and the error of depth against the time of training where a row has one. */
CN_NODISCARD cn_status cn_tradeoff_draw_fields(const cn_tradeoff *tradeoff, const char *path);
#endif
