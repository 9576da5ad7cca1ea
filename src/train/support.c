/* One photo may show something that no other photo shows: a wall, or a passer-by. Where an effect asks for it,
 * matter that only one photo shows costs a little, so that the photo's own transients explain it instead.
 *
 * Each cell stores the photo that saw its matter last, the last step in which that was another photo, and how often
 * the photo has seen it since. A cell at a sparse point needs no support, because two photos agree on the point. A
 * cell is a hundredth of the tile's half extent wide, about the width of a person on a square; in larger cells one
 * person would support another. So fine a grid is mostly empty, so cells share their memory by a hash. Not measured
 * apart. */
#include "train/support.h"

#include "rays/rays.h"

#include <float.h>
#include <math.h>

#define SEEN 0.1f /* part of the light that reaches a cell; from here on a photo counts as showing its matter */

/* A cell is single-view under two conditions. No second photo saw it for so many steps times the number of photos,
 * so each photo has had its turn. And the one photo saw it so often. Without the second condition, small or far
 * cells that all photos rarely see would count. OFTEN tuned on fox: 30.4 dB, and 29.5 without it. REMEMBERED: not
 * measured apart. */
enum { REMEMBERED = 40 };
#define OFTEN 8.0f

enum { RES = 4 * CN_OCC_RES }; /* cells along an axis of contracted space */

static uint32_t place_of(uint32_t x, uint32_t y, uint32_t z)
{
    return ((x ^ y * 2654435761u ^ z * 805459861u) * 2246822519u) >> 10;
}
_Static_assert(CN_SUPPORT_CELLS == 1 << (32 - 10), "place_of gives 22 bits");

uint32_t cn_support_cell(float x, float y, float z)
{
    const float v[3] = { x, y, z };
    uint32_t c[3];
    for (int a = 0; a < 3; a++)
        c[a] = (uint32_t)fminf(fmaxf(v[a] * RES, 0), RES - 1);
    return place_of(c[0], c[1], c[2]);
}

/* The cell along one axis, so many cells from that of a contracted coordinate. */
static uint32_t cell_about(float contracted, int offset)
{
    const float cell = floorf(contracted * RES) + (float)offset;
    return (uint32_t)fminf(fmaxf(cell, 0), RES - 1);
}

static void trust_about(cn_support *s, const cn_box *box, const double point[3])
{
    float x[3];
    cn_box_contract(box, point, x);
    for (int i = 0; i < 27; i++) {
        const uint32_t cx = cell_about(x[0], i % 3 - 1), cy = cell_about(x[1], i / 3 % 3 - 1),
                       cz = cell_about(x[2], i / 9 - 1);
        s->since[place_of(cx, cy, cz)] = FLT_MAX;
    }
}

void cn_support_carve(cn_support *s, cn_arena *arena, size_t lanes)
{
    s->photo = CN_ARENA_NEW(arena, float, CN_SUPPORT_CELLS);
    s->since = CN_ARENA_NEW(arena, float, CN_SUPPORT_CELLS);
    s->times = CN_ARENA_NEW(arena, float, CN_SUPPORT_CELLS);
    s->visit = CN_ARENA_NEW(arena, uint32_t, lanes);
}

void cn_support_begin(cn_support *s, const cn_scene *scene, const cn_box *box)
{
    for (uint32_t i = 0; i < scene->n_points; i++)
        if (scene->points[i].n_observations > 1) trust_about(s, box, scene->points[i].xyz);
}

void cn_support_list(const cn_support *s, cn_checkpoint *c)
{
    const size_t n = s->photo ? CN_SUPPORT_CELLS : 0;
    cn_checkpoint_add(c, "support.photo", CN_F32, n, s->photo);
    cn_checkpoint_add(c, "support.since", CN_F32, n, s->since);
    cn_checkpoint_add(c, "support.times", CN_F32, n, s->times);
}

void cn_support_note(cn_support *s, const cn_batch *b, uint32_t group)
{
    const size_t first = b->group_panel[group] * CN_PANEL;
    for (size_t i = first; i < first + b->group_samples[group]; i++) {
        const float *pos = b->pos + i / CN_PANEL * (3 * CN_PANEL) + i % CN_PANEL;
        s->visit[i] = cn_support_cell(pos[0], pos[CN_PANEL], pos[2 * CN_PANEL]);
    }
}

void cn_support_update(cn_support *s, const cn_batch *b, uint32_t step, uint32_t group)
{
    size_t i = b->group_panel[group] * CN_PANEL;
    for (uint32_t r = group * CN_GROUP; r < (group + 1) * CN_GROUP; r++) {
        const float photo = (float)b->ray_photo[r] + 1; /* 0: none yet */
        uint32_t before = CN_SUPPORT_CELLS;             /* a ray counts once for a cell */
        for (const size_t end = i + b->ray_samples[r]; i < end; i++) {
            const uint32_t cell = s->visit[i];
            if (!(b->visit_seen[i] >= SEEN) || cell == before) continue;
            before = cell;
            if (s->photo[cell] != photo) s->since[cell] = fmaxf(s->since[cell], (float)step), s->times[cell] = 0;
            s->photo[cell] = photo;
            s->times[cell]++;
        }
    }
}

float cn_support_remembered(const cn_support *s)
{
    return (float)REMEMBERED * (float)s->n_photos;
}

void cn_support_mark(const cn_support *s, const uint32_t *cell, uint32_t step, const cn_span *span, cn_worker *w)
{
    const float remembered = cn_support_remembered(s);
    for (uint32_t i = span->first; i < span->first + span->n; i++) {
        const uint32_t c = cell[w->live[i]];
        w->single_view[i] = s->times[c] >= OFTEN && s->since[c] + remembered < (float)step;
    }
}
