/* Street lamps: the light of all lamps in reach of a place. */
#include "synth/world.h"

#include "synth/noise.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define REACH_M 18.0f
#define SQUARE_M 12.0f
#define LIT_M 30.0f /* lamps are lit this far around the photographed square */

static bool reaches(const float bulb[3], float x0, float y0)
{
    const float dx = bulb[0] - fminf(fmaxf(bulb[0], x0), x0 + SQUARE_M),
                dy = bulb[1] - fminf(fmaxf(bulb[1], y0), y0 + SQUARE_M);
    return dx * dx + dy * dy < REACH_M * REACH_M;
}

/* Counts, and with `fill` writes, the lamps of each square. */
static void sort_in(cn_lamp_grid *g, bool fill)
{
    uint32_t n = 0;
    const float low = -0.5f * SQUARE_M * (float)g->side;
    for (uint32_t i = 0; i < g->side * g->side; i++) {
        g->first[i] = n;
        for (uint32_t k = 0; k < g->n_bulbs; k++) {
            if (!reaches(g->bulbs[k], low + SQUARE_M * (float)(i % g->side), low + SQUARE_M * (float)(i / g->side)))
                continue;
            if (fill) g->list[n] = k;
            n++;
        }
    }
    g->first[g->side * g->side] = n;
}

cn_status cn_lamp_grid_init(cn_lamp_grid *g, const cn_town *town)
{
    memset(g, 0, sizeof *g);
    g->side = 2 * (uint32_t)ceilf((town->half_m + LIT_M + REACH_M) / SQUARE_M);
    g->bulbs = calloc(town->n_lamps + 1, sizeof *g->bulbs);
    g->first = calloc((size_t)g->side * g->side + 1, sizeof *g->first);
    for (uint32_t i = 0; i < town->n_lamps && g->bulbs; i++) {
        const cn_lamp *l = &town->lamps[i];
        if (!cn_town_near(town, l->x, l->y, LIT_M)) continue;
        float *bulb = g->bulbs[g->n_bulbs++];
        bulb[0] = l->x + 0.95f * l->dx;
        bulb[1] = l->y + 0.95f * l->dy;
        bulb[2] = CN_WALK_HEIGHT_M + 5.2f;
    }
    if (g->bulbs && g->first) {
        sort_in(g, false);
        g->list = malloc(((size_t)g->first[g->side * g->side] + 1) * sizeof *g->list);
        if (g->list) {
            sort_in(g, true);
            return CN_OK;
        }
    }
    cn_lamp_grid_deinit(g);
    return cn_fail(CN_ERR_NOMEM, "out of memory for the lamps; give a smaller --size");
}

void cn_lamp_grid_deinit(cn_lamp_grid *g)
{
    free(g->bulbs);
    free(g->first);
    free(g->list);
    memset(g, 0, sizeof *g);
}

void cn_world_lamps(const cn_world *world, uint32_t run, const cn_facet *facet, bool quick, float irradiance[3])
{
    const double *place = facet->place;
    const float *normal = facet->normal, wrap = facet->wrap;
    static const float WARM[3] = { 1, 0.7f, 0.38f };
    const cn_lamp_grid *g = &world->lamps;
    const double at_x = floor(place[0] / SQUARE_M) + g->side / 2, at_y = floor(place[1] / SQUARE_M) + g->side / 2;
    if (at_x < 0 || at_y < 0 || at_x >= g->side || at_y >= g->side) return;
    const uint32_t square = (uint32_t)at_y * g->side + (uint32_t)at_x;
    for (uint32_t i = g->first[square]; i < g->first[square + 1]; i++) {
        const float *bulb = g->bulbs[g->list[i]];
        const double to[3] = { bulb[0] - place[0], bulb[1] - place[1], bulb[2] - place[2] };
        const float r = (float)sqrt(to[0] * to[0] + to[1] * to[1] + to[2] * to[2]) + 1e-3f;
        const float d[3] = { (float)to[0] / r, (float)to[1] / r, (float)to[2] / r };
        const float cosine = (d[0] * normal[0] + d[1] * normal[1] + d[2] * normal[2] + wrap) / (1 + wrap);
        if (cosine <= 0 || r > REACH_M) continue;
        /* Mostly down, a little to the sides; nothing at the end of its reach. */
        const float aim = 0.06f + 0.94f * cn_smooth(-0.15f, 0.6f, d[2]), fade = cn_smooth(REACH_M, 0.6f * REACH_M, r);
        if (!quick && cn_tracer_blocked(world->tracer, place, to, 0.97)) continue;
        const float e = world->lights[run].lamp * aim * fade * cosine / (r * r + 0.5f);
        for (int c = 0; c < 3; c++)
            irradiance[c] += e * WARM[c];
    }
}
