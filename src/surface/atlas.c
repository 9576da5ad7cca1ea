#include "surface/atlas.h"

#include <stdlib.h>
#include <string.h>

enum { LEAST_SIDE = 64 };

/* A step of the skyline: from x on, everything below y is used. */
typedef struct step {
    uint32_t x, y;
} step;
typedef struct skyline {
    uint32_t side, n;
    step *steps; /* one more than the side at most */
} skyline;

void cn_atlas_deinit(cn_atlas *atlas)
{
    free(atlas->pages);
    *atlas = (cn_atlas){ 0 };
}

/* The height at which a rectangle that begins at step i may lie; UINT32_MAX: it does not fit. */
static uint32_t height_at(const skyline *s, uint32_t i, uint32_t width, uint32_t height)
{
    const uint32_t end = s->steps[i].x + width;
    uint32_t y = 0;
    if (end > s->side) return UINT32_MAX;
    for (; i < s->n && s->steps[i].x < end; i++)
        if (s->steps[i].y > y) y = s->steps[i].y;
    return y + height <= s->side ? y : UINT32_MAX;
}

/* Raises the skyline from step i on. */
static void raise_skyline(skyline *s, uint32_t i, uint32_t width, uint32_t y)
{
    const uint32_t x = s->steps[i].x, end = x + width;
    uint32_t last = i, after = s->steps[i].y;
    while (last < s->n && s->steps[last].x < end)
        after = s->steps[last++].y;
    const bool rest = end < s->side && (last == s->n || s->steps[last].x > end);
    memmove(s->steps + i + 1 + rest, s->steps + last, (s->n - last) * sizeof *s->steps);
    s->n = s->n - last + i + 1 + rest;
    s->steps[i] = (step){ x, y };
    if (rest) s->steps[i + 1] = (step){ end, after };
}

static bool place(skyline *s, cn_chart *chart)
{
    const uint32_t width = chart->size_px[0] + CN_ATLAS_GUTTER, height = chart->size_px[1] + CN_ATLAS_GUTTER;
    uint32_t best = UINT32_MAX, at = 0;
    for (uint32_t i = 0; i < s->n; i++) {
        const uint32_t y = height_at(s, i, width, height);
        if (y < best) best = y, at = i;
    }
    if (best == UINT32_MAX) return false;
    chart->at_px[0] = s->steps[at].x;
    chart->at_px[1] = best;
    raise_skyline(s, at, width, best + height);
    return true;
}

static int by_height(const void *a, const void *b)
{
    const cn_chart *p = a, *q = b;
    if (p->size_px[1] != q->size_px[1]) return p->size_px[1] > q->size_px[1] ? -1 : 1;
    if (p->size_px[0] != q->size_px[0]) return p->size_px[0] > q->size_px[0] ? -1 : 1;
    return p->first < q->first ? -1 : 1;
}

static int by_first(const void *a, const void *b)
{
    const cn_chart *p = a, *q = b;
    if (p->page != q->page) return p->page < q->page ? -1 : 1;
    return p->first < q->first ? -1 : 1;
}

/* Charts of the page are marked with its number. Returns how many fit. */
static uint32_t fill(cn_chart *charts, uint32_t n, skyline *s, uint32_t page)
{
    uint32_t fitting = 0;
    s->n = 1;
    s->steps[0] = (step){ CN_ATLAS_GUTTER, CN_ATLAS_GUTTER };
    qsort(charts, n, sizeof *charts, by_height);
    for (uint32_t i = 0; i < n; i++) {
        charts[i].page = place(s, &charts[i]) ? page : UINT32_MAX;
        fitting += charts[i].page == page;
    }
    qsort(charts, n, sizeof *charts, by_first);
    return fitting;
}

static uint64_t texels(const cn_chart *c)
{
    return (uint64_t)(c->size_px[0] + CN_ATLAS_GUTTER) * (c->size_px[1] + CN_ATLAS_GUTTER);
}

/* A page from chart `first` on: as many as its area holds, less those that find no place in it. */
static cn_status add_page(cn_charts *charts, uint32_t first, uint32_t side_px, skyline *s, cn_atlas *atlas)
{
    uint64_t area = 0;
    uint32_t n = 0;
    while (first + n < charts->n && area + texels(&charts->charts[first + n]) <= (uint64_t)side_px * side_px)
        area += texels(&charts->charts[first + n++]);
    if (!n) return cn_fail(CN_ERR_USAGE, "a chart does not fit on a page of %u texels; give larger pages", side_px);
    s->side = side_px;
    if (first + n == charts->n) {
        for (s->side = LEAST_SIDE; (uint64_t)s->side * s->side < area && s->side < side_px;)
            s->side += LEAST_SIDE;
        if (s->side > side_px) s->side = side_px;
    }
    uint32_t fitting = fill(charts->charts + first, n, s, atlas->n);
    while (fitting < n && s->side < side_px) {
        s->side += (s->side / 8 + LEAST_SIDE - 1) / LEAST_SIDE * LEAST_SIDE;
        if (s->side > side_px) s->side = side_px;
        fitting = fill(charts->charts + first, n, s, atlas->n);
    }
    if (!fitting)
        return cn_fail(CN_ERR_USAGE, "a chart does not fit on a page of %u texels; give larger pages", side_px);
    if (atlas->n == atlas->room) {
        const uint32_t room = atlas->room ? 2 * atlas->room : 16;
        cn_atlas_page *pages = realloc(atlas->pages, room * sizeof *pages);
        if (!pages) return cn_fail(CN_ERR_NOMEM, "out of memory for %u pages", room);
        atlas->pages = pages;
        atlas->room = room;
    }
    atlas->pages[atlas->n++] = (cn_atlas_page){ s->side, first, fitting };
    return CN_OK;
}

cn_status cn_atlas_pack(cn_charts *charts, uint32_t side_px, cn_atlas *atlas)
{
    skyline s = { .steps = malloc((side_px + (size_t)2) * sizeof *s.steps) };
    cn_status status = s.steps ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory for a page");
    *atlas = (cn_atlas){ 0 };
    for (uint32_t first = 0; first < charts->n && status == CN_OK;) {
        status = add_page(charts, first, side_px, &s, atlas);
        if (status == CN_OK) first += atlas->pages[atlas->n - 1].n;
    }
    free(s.steps);
    if (status != CN_OK) cn_atlas_deinit(atlas);
    return status;
}
