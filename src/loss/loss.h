/* Loss terms over a ray's samples. Each is one file and one constant descriptor; registry.c lists them. A term adds
 * its gradients with respect to the samples' weights and colours, and to the transmittance at the ray's end. A term
 * that is off is not called, and values that only this term needs are not computed. */
#ifndef CONURB_LOSS_LOSS_H
#define CONURB_LOSS_LOSS_H
#include <stdbool.h>
#include <stdint.h>

enum { CN_MAX_LOSSES = 16 };

/* One ray: its live samples, front to back. */
typedef struct cn_loss_ray {
    uint32_t n;
    const float *weight;        /* [n] */
    const float *colour;        /* [n][3] */
    const float *log_distance;  /* [n] */
    const uint8_t *single_view; /* [n] 1 for samples that only one photo shows; NULL where no term asks for it */
    float after;                /* transmittance that is left at the end */
    float covered;              /* how much of what lies behind the end the background gives: 0 none, 1 all */
    float mean;                 /* weighted mean of log_distance; it counts as a constant in gradients */
    float brightest;            /* channel of what the samples show together; it counts as a constant as well */
    float log_depth;            /* log-distance of the sparse point that the ray goes through, where it has_depth */
    bool has_depth;
    float log_measured; /* log-distance by the depth map, where it has_measured */
    bool has_measured;
    /* Where has_plane: the log-distance of the plane through a neighbouring ray's depth, with the normal of the photos'
     * normal maps; it counts as a constant. plane_width: its change for a turn of the plane by one radian. */
    float log_plane, plane_width;
    bool has_plane;
    bool counts;          /* the photo's pixel has a weight above 0 */
    const float *d_pixel; /* [3] gradient of the composited colour */
    float scale;          /* of a ray's loss */
    float cue_weight;     /* weight of depths that nobody measured; falls over the schedule */
    float cue_deviation;  /* weight of the mean deviation from them: smaller where single pixels are wrong */
    float prior_weight;   /* prior weight: of terms that no photo confirms; falls from 1 to 0 as the photos are
                           * explained */
} cn_loss_ray;

/* Gradients, to be added to. */
typedef struct cn_loss_grad {
    float *weight; /* [n] */
    float *colour; /* [n][3] beside what the pixel's colour gives: of terms that look at single samples */
    float after;
} cn_loss_grad;

/* What decides whether a term is on. */
typedef struct cn_loss_scene {
    bool background;  /* an effect gives what lies behind the scene */
    bool sparse;      /* some rays go through sparse points */
    bool measured;    /* photos have depth maps from a depth camera */
    bool cue;         /* photos have depth maps that are right but for scale and shift */
    bool normals;     /* photos have normal maps */
    bool single_view; /* an effect asks for multi-view support */
} cn_loss_scene;

typedef struct cn_loss_term {
    const char *name;
    bool (*on)(const cn_loss_scene *scene); /* NULL: always */
    void (*add)(const cn_loss_ray *ray, cn_loss_grad *grad);
    double (*value)(const cn_loss_ray *ray); /* the loss whose gradient `add` gives; for tests */
} cn_loss_term;

extern const cn_loss_term *const cn_loss_list[];
extern const uint32_t cn_loss_count;

/* The terms of a step that are on. */
typedef struct cn_loss_pack {
    const cn_loss_term *term[CN_MAX_LOSSES];
    uint32_t n;
} cn_loss_pack;
void cn_loss_pack_make(cn_loss_pack *pack, const cn_loss_scene *scene);
/* Adds up the gradients of all terms for one ray. grad->weight and grad->colour are set; grad->after must hold the
 * gradient from shading and is added to. */
void cn_losses_add(const cn_loss_pack *pack, const cn_loss_ray *ray, cn_loss_grad *grad);
#endif
