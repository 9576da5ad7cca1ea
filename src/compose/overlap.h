/* Finds tiles that see the same places, and makes rays to such places. */
#ifndef CONURB_COMPOSE_OVERLAP_H
#define CONURB_COMPOSE_OVERLAP_H
#include "conurb/compose.h"

enum { CN_PLACES_EDGE = 1024, CN_PLACES_MIN = 64 }; /* rays per edge; the fewest that determine an appearance */

/* Pairs of tiles whose circles overlap, by the number of sparse points that at least two photos of each see; where the
 * scene has no points, by their photos in common. Sorted by a, then b; pairs with less than CN_PLACES_MIN are left out.
 * Caller frees. */
CN_NODISCARD cn_status cn_overlap_find(const cn_alignment_input *input, cn_alignment_edge **edges, uint32_t *n);

/* Rays, and what a tile shows along them. */
typedef struct cn_places {
    size_t n, room;
    double (*origin)[3], (*direction)[3];
    float (*rgba)[4], *depth;
    uint32_t *edge; /* for the caller */
    /* Of the scene, from the first cn_places_add on: the points of each view, and a mark a view. */
    uint64_t *first;
    uint32_t *points;
    uint8_t *mark;
} cn_places;
CN_NODISCARD cn_status cn_places_init(cn_places *places, size_t room);
void cn_places_deinit(cn_places *places);
/* Adds at most `most` rays from photos of both tiles to places that both may see: to points that two photos of each
 * see, then through pixels at random. The same tiles give the same rays. */
CN_NODISCARD cn_status cn_places_add(cn_places *places, const cn_alignment_input *input, uint32_t a, uint32_t b,
                                     size_t most);
#endif
