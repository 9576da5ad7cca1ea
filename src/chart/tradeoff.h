/* SVG plots of what accuracy costs. */
#ifndef CONURB_CHART_TRADEOFF_H
#define CONURB_CHART_TRADEOFF_H
#include "conurb/measure.h"

/* Bars: dB that each effect adds, beside the seconds that it takes. Row 0 is the plan's choice, the others have one
 * effect turned, and are named with-NAME or without-NAME. */
CN_NODISCARD cn_status cn_plot_effects(const cn_tradeoff *tradeoff, const char *path);
/* Time against held-out PSNR, training and rendering apart; the Pareto front drawn and named; a dot's area is its
 * memory. */
CN_NODISCARD cn_status cn_plot_front(const cn_tradeoff *tradeoff, const char *path);
/* Whether no other row is both quicker to train and better. */
bool cn_plot_on_front(const cn_tradeoff *tradeoff, uint32_t row, bool render);
#endif
