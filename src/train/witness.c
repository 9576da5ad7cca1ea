/* Which photos show a place. What a photo sees of a place that no other shows may stand there for all that is known, a
 * passer-by as well as a wall: where an effect asks for witnesses, such matter costs a little, so that the photo's own
 * transients take it instead.
 *
 * A cell remembers the photo that saw its matter last, since when that was no other, and how often it did. About a
 * sparse point, which two photos agree on, there is nothing to prove. A cell is a hundredth of the tile's half extent
 * wide, as a person is on a square: in larger ones one crowd is another's witness. So fine a grid is mostly empty, and
 * its cells share what is remembered by a hash. */
#include "train/trainer.h"

#include <float.h>
#include <math.h>

#define SEEN 0.1f       /* of what reaches a cell: from here on a photo shows its matter */
#define LONE_LOSS 0.12f /* squared error that an opaque ray costs in cells with one witness */

/* A cell has one witness when no second came for so many steps a photo, in which each has had its turn, and the one
 * came so often: of a small or far cell, which all look at seldom, that much time says nothing. */
enum { REMEMBERED = 40 };
#define OFTEN 8.0f

enum { RES = 4 * CN_OCC_RES }; /* cells along an axis of contracted space */

static uint32_t place_of(uint32_t x, uint32_t y, uint32_t z)
{
    return ((x ^ y * 2654435761u ^ z * 805459861u) * 2246822519u) >> 10;
}
_Static_assert(CN_WITNESS_CELLS == 1 << (32 - 10), "place_of gives 22 bits");

uint32_t cn_witness_cell(float x, float y, float z)
{
    const float v[3] = { x, y, z };
    uint32_t c[3];
    for (int a = 0; a < 3; a++)
        c[a] = (uint32_t)fminf(fmaxf(v[a] * RES, 0), RES - 1);
    return place_of(c[0], c[1], c[2]);
}

/* A cell of one axis, so many from that of a contracted coordinate. */
static uint32_t cell_about(double contracted, int offset)
{
    const double cell = floor((contracted + 2) * RES / 4) + offset;
    return (uint32_t)fmin(fmax(cell, 0), RES - 1);
}

static void trust_about(cn_trainer *t, const double point[3])
{
    double x[3], m = 1;
    for (int a = 0; a < 3; a++) {
        x[a] = (point[a] - t->box.centre[a]) / t->box.half_extent[a];
        m = fmax(m, fabs(x[a]));
    }
    for (int a = 0; a < 3; a++)
        x[a] *= (2 - 1 / m) / m;
    for (int i = 0; i < 27; i++) {
        const uint32_t cx = cell_about(x[0], i % 3 - 1), cy = cell_about(x[1], i / 3 % 3 - 1),
                       cz = cell_about(x[2], i / 9 - 1);
        t->changed[place_of(cx, cy, cz)] = FLT_MAX;
    }
}

void cn_witness_begin(cn_trainer *t)
{
    const cn_scene *scene = t->input->scene;
    for (uint32_t i = 0; i < scene->n_points; i++)
        if (scene->points[i].n_observations > 1) trust_about(t, scene->points[i].xyz);
}

void cn_witness_note(cn_trainer *t, uint32_t group)
{
    const size_t first = t->group_panel[group] * CN_PANEL;
    for (size_t i = first; i < first + t->group_samples[group]; i++) {
        const float *pos = t->pos + i / CN_PANEL * (3 * CN_PANEL) + i % CN_PANEL;
        t->visit_witness[i] = cn_witness_cell(pos[0], pos[CN_PANEL], pos[2 * CN_PANEL]);
    }
}

void cn_witness_update(cn_trainer *t, uint32_t group)
{
    const size_t first = t->group_panel[group] * CN_PANEL;
    size_t i = first;
    for (uint32_t r = group * CN_GROUP; r < (group + 1) * CN_GROUP; r++) {
        const float photo = (float)t->ray_photo[r];
        uint32_t before = CN_WITNESS_CELLS; /* a ray looks at a cell once */
        for (const size_t end = i + t->ray_samples[r]; i < end; i++) {
            const uint32_t cell = t->visit_witness[i];
            if (!(t->visit_seen[i] >= SEEN) || cell == before) continue;
            before = cell;
            if (t->witness[cell] != photo)
                t->changed[cell] = fmaxf(t->changed[cell], (float)t->step), t->alone[cell] = 0;
            t->witness[cell] = photo;
            t->alone[cell]++;
        }
    }
}

void cn_witness_backward(const cn_trainer *t, uint32_t group, const cn_span *s, float scale, cn_worker *w)
{
    const uint32_t *cell = t->visit_witness + t->group_panel[group] * CN_PANEL;
    const float remembered = (float)REMEMBERED * (float)t->n_photos;
    float sum_behind = 0;
    for (uint32_t i = s->first + s->n; i-- > s->first;) {
        const uint32_t c = cell[w->live[i]];
        const bool lone = t->alone[c] >= OFTEN && t->changed[c] + remembered < (float)t->step;
        const float d_weight = lone ? scale * LONE_LOSS : 0;
        w->d_logit[i] += (w->behind[i] * d_weight - sum_behind) * w->tau[i];
        sum_behind += w->weight[i] * d_weight;
    }
}
