/* Charts of what accuracy costs. Private to stage/. */
#ifndef CONURB_STAGE_TRADEOFF_CHART_H
#define CONURB_STAGE_TRADEOFF_CHART_H
#include "conurb/measure.h"

/* Bars: dB that each effect adds, beside the seconds that it takes. Row 0 is the plan's choice, the others have one
 * effect turned, and are named with-NAME or without-NAME. */
CN_NODISCARD cn_status cn_tradeoff_draw_effects(const cn_tradeoff *tradeoff, const char *path);
/* Time against held-out PSNR, training and rendering apart; the Pareto front drawn and named; a dot's area is its
 * memory. */
CN_NODISCARD cn_status cn_tradeoff_draw_front(const cn_tradeoff *tradeoff, const char *path);
#endif
