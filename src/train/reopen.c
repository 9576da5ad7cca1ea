/* Cells that were emptied too early. A march skips an empty cell, so nothing in it is learnt again: ground that the
 * long steps of the beginning missed, or that fog hid, would stay a hole for ever. A ray that ends in nothing, where no
 * sky can be what it saw, says that such a cell is on its way: those with full ones about them are opened, for some
 * looks. Where there is a surface it now grows; elsewhere the cell is soon empty again. (Opening cells beside full ones
 * everywhere, asked for or not, costs 2.8 dB on fox.) */
#include "train/trainer.h"

#include <math.h>

enum { MAX_RAYS = 64, MAX_CELLS = 512 }; /* a step; a ray */
#define FROM 0.1                         /* of the schedule: before, there is fog everywhere */
#define TO 0.9
#define OPENED 0.5f /* what such a cell is taken to show: empty after some twenty looks */
#define PACE 1.0078125f
#define HORIZON 0.0f /* z of a direction; what is above may be sky where an effect has one */
#define NOTHING 0.5f /* of a ray that is left at its end */

void cn_reopen_note(cn_trainer *t, uint32_t ray, float after)
{
    const bool may_be_sky = t->pack.background.n && t->dirs[3 * (size_t)ray + 2] > HORIZON;
    t->ray_hole[ray] = after > NOTHING && !may_be_sky;
}

static uint32_t cell_at(const cn_box_ray *ray, float at, uint32_t c[3])
{
    float x[3], m = 1;
    for (int a = 0; a < 3; a++) {
        x[a] = ray->origin[a] + at * ray->dir[a];
        m = fmaxf(m, fabsf(x[a]));
    }
    for (int a = 0; a < 3; a++) {
        const float scaled = (x[a] * (2 - 1 / m) / m + 2) * (CN_OCC_RES / 4.0f);
        c[a] = (uint32_t)fminf(fmaxf(scaled, 0), CN_OCC_RES - 1);
    }
    return c[0] + CN_OCC_RES * (c[1] + CN_OCC_RES * c[2]);
}

static bool is_full(const cn_occupancy *occ, uint32_t cell)
{
    return occ->bits[cell >> 5] >> (cell & 31) & 1;
}

/* In a hole of a surface a cell has more than one full neighbour; before a surface it has one. */
static bool in_a_gap(const cn_occupancy *occ, uint32_t cell, const uint32_t c[3])
{
    static const uint32_t stride[3] = { 1, CN_OCC_RES, CN_OCC_RES * CN_OCC_RES };
    int full = 0;
    for (int a = 0; a < 3; a++) {
        full += c[a] > 0 && is_full(occ, cell - stride[a]);
        full += c[a] < CN_OCC_RES - 1 && is_full(occ, cell + stride[a]);
    }
    return full > 1;
}

/* All cells of a ray are found before one is opened: what was just opened opens nothing. */
static void open_along(cn_trainer *t, const cn_box_ray *ray)
{
    cn_occupancy *occ = &t->occ;
    uint32_t found[MAX_CELLS], n = 0, last = UINT32_MAX, c[3];
    for (float at = t->box.near_m; at < t->box.far_m && n < MAX_CELLS; at *= PACE) {
        const uint32_t cell = cell_at(ray, at, c);
        if (cell == last) continue;
        last = cell;
        if (occ->seen[cell] >= 0 && !is_full(occ, cell) && in_a_gap(occ, cell, c)) found[n++] = cell;
    }
    for (uint32_t i = 0; i < n; i++) {
        occ->seen[found[i]] = OPENED;
        occ->bits[found[i] >> 5] |= 1u << (found[i] & 31);
    }
}

void cn_reopen_cells(cn_trainer *t)
{
    const double progress = t->options.steps ? (double)t->step / t->options.steps : 1;
    if (progress < FROM || progress > TO) return;
    for (uint32_t r = 0, done = 0; r < t->n_rays && done < MAX_RAYS; r++) {
        if (!t->ray_hole[r]) continue;
        open_along(t, &t->rays[r].box_ray);
        done++;
    }
}
