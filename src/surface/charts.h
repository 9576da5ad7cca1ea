/* Charts of a mesh: connected triangles that face about the same way, flattened onto a plane. No two triangles of a
 * chart lie over one another by more than a texel. */
#ifndef CONURB_SURFACE_CHARTS_H
#define CONURB_SURFACE_CHARTS_H
#include "surface/mesh.h"

typedef struct cn_chart {
    uint32_t first, n;   /* in cn_charts.triangles */
    double x[3], y[3];   /* axes of its plane: unit length, at right angles */
    double low[2];       /* lowest coordinate on each axis, metres */
    double size[2];      /* metres */
    double texel_m;      /* larger than those of the others where a single triangle is wider than a page */
    uint32_t page;       /* where cn_atlas_pack put it */
    uint32_t at_px[2];   /* its first texel, within the gutter */
    uint32_t size_px[2]; /* without the gutter */
} cn_chart;
typedef struct cn_charts {
    cn_chart *charts;
    uint32_t n, room;
    uint32_t *triangles; /* of all charts, one chart after another */
    uint32_t n_triangles;
} cn_charts;
void cn_charts_deinit(cn_charts *charts); /* fine when zeroed */
typedef struct cn_chart_limits {
    double texel_m, largest_m;
    uint32_t most_px;
} cn_chart_limits;
/* Grows charts over the whole mesh: from a triangle to its neighbours while they face within 60 degrees of the chart's
 * mean and lie within largest_m of the first. A chart then has at most 2 * largest_m on a side, unless its first
 * triangle is larger; its texels grow until it has at most most_px + 2 of them on a side. Memory: 60 bytes for each
 * triangle. CN_ERR_NOMEM, CN_ERR_INTERRUPTED. */
CN_NODISCARD cn_status cn_charts_grow(const cn_context *ctx, const cn_mesh *mesh, const cn_chart_limits *limits,
                                      cn_charts *charts);
/* Place of a vertex in the chart, in texels from its first texel's corner. */
void cn_chart_project(const cn_chart *chart, const float xyz[3], double px[2]);

/* Calls `texel` for each texel of a chart's triangle: those whose centre the triangle covers, and, after them,
 * those that its sides run through.
 * part: weights of the three corners. */
typedef struct cn_chart_texel {
    uint32_t x, y; /* in the chart */
    double part[3];
    bool side; /* one that a side runs through; the centre may lie outside the triangle */
} cn_chart_texel;
typedef void (*cn_chart_visit)(void *user, uint32_t triangle, const cn_chart_texel *texel);
void cn_chart_rasterise(const cn_mesh *mesh, const cn_chart *chart, uint32_t triangle, cn_chart_visit visit,
                        void *user);
#endif
