/* Places names beside dots and circles, so that they do not cover each other. */
#ifndef CONURB_CHART_LABELS_H
#define CONURB_CHART_LABELS_H
#include "chart/chart.h"

enum { CN_LABELS_MOST = 512 };
typedef struct cn_labels {
    cn_box area; /* names should stay inside */
    cn_box taken[CN_LABELS_MOST];
    double weight[CN_LABELS_MOST];
    uint32_t n;
} cn_labels;

/* Names should not cover this box. A larger weight is worse; leaving the area weighs 8. No more than CN_LABELS_MOST. */
void cn_labels_avoid(cn_labels *labels, const cn_box *box, double weight);

/* The dot or circle that the name belongs to. */
typedef struct cn_labelled {
    double x, y, radius;
    double towards; /* the side to try first, an angle in radians from east, counter-clockwise */
    int rings;      /* how many distances to try */
} cn_labelled;
/* Finds the best of sixteen sides and of all distances, nearest first. Returns the sum of the weights that the name's
 * box covers; 0: none. The box is not reserved: call avoid when the name is drawn. */
double cn_labels_place(const cn_labels *labels, const cn_labelled *of, const cn_letters *letters, const char *name,
                       cn_box *box);
/* Draws the name in the middle of its box. */
void cn_labels_draw(const cn_chart *chart, const cn_box *box, const cn_letters *letters, const char *name);
#endif
