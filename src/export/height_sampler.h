/* Samples heights and colours straight below places, with one tile open at a time. */
#ifndef CONURB_EXPORT_HEIGHT_SAMPLER_H
#define CONURB_EXPORT_HEIGHT_SAMPLER_H
#include "conurb/export.h"

typedef struct cn_height_sampler {
    cn_context ctx;
    const cn_survey *survey;
    double top_m,
        bottom_m; /* local z of the sparse points, a little more: heights count from the top, and end at the bottom */
    const cn_survey_tile *place; /* of the tile that is open */
    cn_tile *tile;
    double start_m;           /* local z at which its rays begin: the top or above */
    cn_render_options render; /* for that tile, in the light of row */
    cn_appearance row;
} cn_height_sampler;

/* ctx may be NULL. Nothing is open yet. */
CN_NODISCARD cn_status cn_height_sampler_init(cn_height_sampler *sampler, const cn_context *ctx,
                                              const cn_survey *survey);
/* Opens a tile; closes the one that was open. */
CN_NODISCARD cn_status cn_height_sampler_open(cn_height_sampler *sampler, uint32_t tile);
void cn_height_sampler_deinit(cn_height_sampler *sampler);

/* Whether `wanted` photos of the open tile (all, if it has fewer) look at a place. A margin of 0.25 adds a quarter of
 * the picture's sides around it. */
bool cn_height_sampler_sees(const cn_height_sampler *sampler, const double xyz[3], uint32_t wanted, double margin);

/* Where to sample: local points at the top, and unit directions. The results: */
typedef struct cn_height_samples {
    size_t n;
    double (*top)[3], (*down)[3];
    float *weight;    /* 0: there is no surface, or the tile has no weight there */
    float *below_m;   /* along the ray from the top; negative above it */
    float (*rgba)[4]; /* premultiplied ACEScg */
    size_t room;
    /* Scratch of cn_height_sampler_down. */
    double (*origin)[3], (*direction)[3];
    float (*found)[4], *depth;
    uint32_t *which;
} cn_height_samples;
CN_NODISCARD cn_status cn_height_samples_init(cn_height_samples *samples, size_t room);
void cn_height_samples_deinit(cn_height_samples *samples);
/* Fills weight, below_m and rgba of the n places from the open tile. */
CN_NODISCARD cn_status cn_height_sampler_down(cn_height_sampler *sampler, cn_height_samples *samples);
#endif
