/* Facts about a city, for the page. Each function returns JSON that the caller owns; NULL when out of memory. */
#ifndef CONURB_VIEW_FACTS_H
#define CONURB_VIEW_FACTS_H
#include "city/workspace.h"
#include "conurb/colour.h"

#include <jansson.h>

enum { CN_FACTS_VIEWS = 4000, CN_FACTS_POINTS = 60000, CN_FACTS_CURVE = 400 };

/* Frame, tiles, views (at most CN_FACTS_VIEWS, evenly thinned), blends, views and looks of the colour config. */
json_t *cn_facts_city(const cn_city *city, const cn_dataset *dataset, const cn_colour *colour);
/* A tile's effects, its scores, and its training curve: lists of step, psnr and samples_per_s. CN_ERR_USAGE: the plan
 * has no such tile. */
CN_NODISCARD cn_status cn_facts_tile(const cn_city *city, const cn_dataset *dataset, const char *id, json_t **out);
/* Sparse points, at most CN_FACTS_POINTS: each is 3 floats (metres), 3 bytes (RGB) and 1 unused byte. The caller frees
 * *bytes. */
CN_NODISCARD cn_status cn_facts_points(const cn_dataset *dataset, uint8_t **bytes, size_t *size, uint32_t *n);
/* The facts that change during training: {"state": as `conurb status --json`, "trained": {ID: a text that changes
 * with the tile}}. */
CN_NODISCARD cn_status cn_facts_state(const cn_context *ctx, cn_city *city, const cn_dataset *dataset, json_t **out);
#endif
