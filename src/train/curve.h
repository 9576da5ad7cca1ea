/* How held-out PSNR grows with the time of training. Private to train/. */
#ifndef CONURB_TRAIN_CURVE_H
#define CONURB_TRAIN_CURVE_H
#include <stdint.h>

/* The last scores on the validation photos, oldest first. */
enum { CN_CURVE_POINTS = 4 };
typedef struct cn_curve {
    uint32_t n;
    double at_s[CN_CURVE_POINTS], psnr[CN_CURVE_POINTS];
} cn_curve;

void cn_curve_add(cn_curve *curve, double at_s, double psnr);
/* The gain in dB that is expected from the next `seconds`: the slope of the line through the last scores, by least
 * squares. The curve flattens, so the real gain is rather less. INFINITY until there are CN_CURVE_POINTS
 * scores. */
double cn_curve_gain(const cn_curve *curve, double seconds);
#endif
