/* Activations of consecutive panels, each array [n_panels][rows][CN_PANEL]. */
#ifndef CONURB_FIELD_ACTS_H
#define CONURB_FIELD_ACTS_H

#define CN_GEO 16 /* geometry features of the small networks */

typedef struct cn_field_acts {
    float *enc;    /* enc_rows: the encoding */
    float *in;     /* colour_in: geometry features, then conditioning (filled by the caller before the colour pass) */
    float *out;    /* 4: colour, before cn_field_light; row 3 is padding */
    float *own[4]; /* what a type's passes keep from one to the next */
} cn_field_acts;

/* Gradients on the way back. */
typedef struct cn_field_gradient {
    const cn_field_acts *acts;
    const float *logit; /* [n_panels][CN_PANEL]: of the density logits */
    float *weights;     /* added to */
} cn_field_gradient;
#endif
