#include "chart/labels.h"

#include "base/units.h"

#include <math.h>

#define GAP 3.0   /* between a name and what it belongs to */
#define RING 12.0 /* between distances that are tried */
#define OUTSIDE 8.0

void cn_labels_avoid(cn_labels *labels, const cn_box *box, double weight)
{
    if (labels->n == CN_LABELS_MOST) return;
    labels->taken[labels->n] = *box;
    labels->weight[labels->n++] = weight;
}

static double harm(const cn_labels *l, const cn_box *box)
{
    const bool inside = box->x0 > l->area.x0 && box->x1 < l->area.x1 && box->y0 > l->area.y0 && box->y1 < l->area.y1;
    double sum = inside ? 0 : OUTSIDE;
    for (uint32_t i = 0; i < l->n; i++)
        if (cn_box_overlap(box, &l->taken[i])) sum += l->weight[i];
    return sum;
}

double cn_labels_place(const cn_labels *labels, const cn_labelled *of, const cn_letters *letters, const char *name,
                       cn_box *box)
{
    static const int turns[] = { 0, 1, -1, 2, -2, 3, -3, 4, -4, 5, -5, 6, -6, 7, -7, 8 };
    const double half_w = cn_chart_text_width(letters, name) / 2 + 2, half_h = 0.5 * letters->size + 2;
    double least = INFINITY;
    for (int ring = 0; ring < of->rings; ring++)
        for (size_t i = 0; i < sizeof turns / sizeof *turns; i++) {
            const double angle = of->towards + turns[i] * CN_PI / 8, ux = cos(angle), uy = -sin(angle);
            const double reach = of->radius + GAP + ring * RING + fabs(ux) * half_w + fabs(uy) * half_h;
            const double x = of->x + ux * reach, y = of->y + uy * reach;
            const cn_box tried = { x - half_w, y - half_h, x + half_w, y + half_h };
            const double sum = harm(labels, &tried);
            if (sum < least) least = sum, *box = tried;
            if (least == 0) return 0;
        }
    return least;
}

void cn_labels_draw(const cn_chart *chart, const cn_box *box, const cn_letters *letters, const char *name)
{
    cn_letters middle = *letters;
    middle.anchor = CN_ANCHOR_MIDDLE;
    cn_chart_text(chart, (box->x0 + box->x1) / 2, (box->y0 + box->y1) / 2 + 0.36 * letters->size, &middle, name);
}
