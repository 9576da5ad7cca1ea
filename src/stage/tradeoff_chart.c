#include "stage/tradeoff_chart.h"

#include "base/number.h"
#include "base/units.h"
#include "chart/axis.h"
#include "chart/labels.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define FRONT "#2a5fa8"
#define LEFT 24.0

static const cn_letters title = { .size = 18 };
static const cn_letters about = { .size = 12, .colour = CN_CHART_GREY };

/* ---- bars of effects ---- */

enum { ROW = 34, FIRST_ROW = 108 };

static bool is_on(const cn_tradeoff_row *turned)
{
    return strncmp(turned->name, "without", 7) == 0;
}

/* dB and seconds that the effect of a row adds when it is on. */
static void worth(const cn_tradeoff *t, uint32_t i, double *db, double *seconds)
{
    const cn_tradeoff_row *planned = &t->rows[0], *turned = &t->rows[i];
    const double sign = is_on(turned) ? 1 : -1;
    *db = sign * (planned->half_psnr - turned->half_psnr);
    *seconds = sign * (planned->train_s - turned->train_s);
}

/* An axis symmetric about 0, for bars of both signs. */
static cn_axis axis_of_bars(double start, double end, double least)
{
    cn_axis a = cn_axis_from(start, end);
    cn_axis_include(&a, -least);
    cn_axis_include(&a, least);
    return a;
}

cn_status cn_tradeoff_draw_effects(const cn_tradeoff *t, const char *path)
{
    cn_axis gain = axis_of_bars(250, 450, 0.1), cost = axis_of_bars(560, 760, 1);
    cn_chart chart;
    double db, seconds;
    CN_TRY(cn_chart_open(&chart));
    for (uint32_t i = 1; i < t->n; i++) {
        worth(t, i, &db, &seconds);
        for (int sign = -1; sign < 2; sign += 2)
            cn_axis_include(&gain, sign * db), cn_axis_include(&cost, sign * seconds);
    }
    cn_chart_text(&chart, LEFT, 32, &title, "What each effect is worth");
    cn_chart_text(&chart, LEFT, 54, &about,
                  "held-out PSNR, right half fitted on the left, and training time: with the effect, less without it");
    const cn_letters head = { .size = 12, .anchor = CN_ANCHOR_MIDDLE }, value = { .size = 12 };
    cn_chart_text(&chart, cn_axis_at(&gain, 0), 84, &head, "dB gained");
    cn_chart_text(&chart, cn_axis_at(&cost, 0), 84, &head, "seconds paid");
    for (uint32_t i = 1; i < t->n; i++) {
        const double y = FIRST_ROW + ROW * (double)(i - 1);
        const char *name = strchr(t->rows[i].name, '-');
        char text[96];
        worth(t, i, &db, &seconds);
        snprintf(text, sizeof text, "%s (%s)", name ? name + 1 : t->rows[i].name, is_on(&t->rows[i]) ? "on" : "off");
        cn_chart_text(&chart, 230, y + 4, &(cn_letters){ .size = 13, .anchor = CN_ANCHOR_END }, text);
        cn_chart_bar(&chart, &gain, db, y, db >= 0 ? "#2a7f4f" : CN_CHART_RED);
        cn_chart_bar(&chart, &cost, seconds, y, "#8a6d1b");
        snprintf(text, sizeof text, "%+.2f dB", db);
        cn_chart_text(&chart, 462, y + 4, &value, text);
        snprintf(text, sizeof text, "%+.0f s", seconds);
        cn_chart_text(&chart, 772, y + 4, &value, text);
    }
    const cn_chart_page page = { "What each effect is worth", 860, FIRST_ROW + ROW * (double)t->n };
    return cn_chart_save(&chart, &page, path);
}

/* ---- fronts ---- */

enum { MOST_DOTS = 64 };

/* A figure of a training that an axis shows. */
typedef struct figure {
    const char *title;
    double (*of)(const cn_tradeoff_row *r);
    bool logarithmic, less_is_better;
} figure;

static double training_of(const cn_tradeoff_row *r)
{
    return fmax(r->train_s, 1e-3);
}
static double rendering_of(const cn_tradeoff_row *r)
{
    return fmax(r->render_s, 1e-3);
}
static double megabytes_of(const cn_tradeoff_row *r)
{
    return fmax(r->disk_bytes / 1e6, 1e-3);
}
static double psnr_of(const cn_tradeoff_row *r)
{
    return r->psnr;
}
static double fitted_of(const cn_tradeoff_row *r)
{
    return r->half_psnr;
}
static double ssim_of(const cn_tradeoff_row *r)
{
    return r->ssim;
}
static double depth_of(const cn_tradeoff_row *r)
{
    return r->depth_error_m;
}
static const figure TRAINING = { "training, s", training_of, true, true },
                    RENDERING = { "rendering, s a photo", rendering_of, true, true },
                    DISK = { "tile on disk, MB", megabytes_of, true, true },
                    PSNR = { "held-out PSNR, dB", psnr_of, false, false },
                    FITTED = { "held-out PSNR, light fitted, dB", fitted_of, false, false },
                    SSIM = { "held-out SSIM", ssim_of, false, false },
                    DEPTH = { "median error of depth, m", depth_of, true, true };

/* One plot: where it is, and what it shows. */
typedef struct panel {
    cn_box at;
    const figure *x, *y;
} panel;

static bool better(const figure *f, double a, double b)
{
    return f->less_is_better ? a < b : a > b;
}

/* Whether no other row is at least as good in both, and better in one. */
static bool on_front(const cn_tradeoff *t, uint32_t row, const panel *p)
{
    const double x = p->x->of(&t->rows[row]), y = p->y->of(&t->rows[row]);
    for (uint32_t i = 0; i < t->n; i++) {
        const double a = p->x->of(&t->rows[i]), b = p->y->of(&t->rows[i]);
        if (i != row && !better(p->x, x, a) && !better(p->y, y, b) && (better(p->x, a, x) || better(p->y, b, y)))
            return false;
    }
    return true;
}

typedef struct dot {
    const char *name;
    double x, y, radius;
    bool on; /* on the Pareto front */
    cn_box box, label;
} dot;

static double radius_of(double bytes, double most)
{
    return 3 + 9 * sqrt(bytes / most);
}

static cn_plot plot_of(const cn_tradeoff *t, const panel *p)
{
    cn_plot plot = { .x = cn_axis_from(p->at.x0, p->at.x1),
                     .y = cn_axis_from(p->at.y1, p->at.y0),
                     .x_title = p->x->title,
                     .y_title = p->y->title };
    plot.x.logarithmic = p->x->logarithmic;
    plot.y.logarithmic = p->y->logarithmic;
    plot.y.ends_at_ticks = !p->y->logarithmic;
    for (uint32_t i = 0; i < t->n; i++) {
        cn_axis_include(&plot.x, p->x->of(&t->rows[i]));
        cn_axis_include(&plot.y, p->y->of(&t->rows[i]));
    }
    cn_axis_fit(&plot.x, 0.12);
    cn_axis_fit(&plot.y, 0.05);
    return plot;
}

static cn_letters letters_of(const dot *d)
{
    return (cn_letters){ .size = d->on ? 12 : 10, .colour = d->on ? "#1d3f73" : "#777", .halo = true };
}

/* Places the names. Overlap with other names costs most, then with the frame, then with dots. Names on the front are
 * placed first. */
static void place_names(const cn_plot *plot, dot *dots, uint32_t n)
{
    cn_labels labels = { .area = cn_plot_box(plot) };
    for (uint32_t i = 0; i < n; i++)
        cn_labels_avoid(&labels, &dots[i].box, 3);
    for (int turn = 0; turn < 2; turn++)
        for (uint32_t i = 0; i < n; i++) {
            if (dots[i].on != (turn == 0)) continue;
            const cn_labelled of = { dots[i].x, dots[i].y, dots[i].radius, CN_PI / 2, 4 };
            const cn_letters letters = letters_of(&dots[i]);
            cn_labels_place(&labels, &of, &letters, dots[i].name, &dots[i].label);
            cn_labels_avoid(&labels, &dots[i].label, 10);
        }
}

static uint32_t place_dots(const cn_plot *plot, const cn_tradeoff *t, double most, const panel *p, dot *dots)
{
    uint32_t n = 0;
    for (uint32_t i = 0; i < t->n && n < MOST_DOTS; i++) {
        const cn_tradeoff_row *r = &t->rows[i];
        const double x = cn_axis_at(&plot->x, p->x->of(r)), y = cn_axis_at(&plot->y, p->y->of(r));
        const double radius = radius_of(r->bytes, most);
        if (!isfinite(x) || !isfinite(y) || !isfinite(radius)) continue;
        dots[n++] = (dot){ .name = r->name,
                           .x = x,
                           .y = y,
                           .radius = radius,
                           .on = on_front(t, i, p),
                           .box = { x - radius, y - radius, x + radius, y + radius } };
    }
    place_names(plot, dots, n);
    return n;
}

static int by_time(const void *x, const void *y)
{
    const double a = ((const double *)x)[0], b = ((const double *)y)[0];
    return (a > b) - (a < b);
}

static void draw_front(const cn_chart *chart, const dot *dots, uint32_t n)
{
    double front[MOST_DOTS][2];
    uint32_t m = 0;
    for (uint32_t i = 0; i < n; i++)
        if (dots[i].on) front[m][0] = dots[i].x, front[m++][1] = dots[i].y;
    qsort(front, m, sizeof *front, by_time);
    cn_chart_polyline(chart, (const double(*)[2])front, m, &(cn_paint){ .stroke = FRONT, .width = 2 });
}

static void draw_dots(const cn_chart *chart, const dot *dots, uint32_t n)
{
    draw_front(chart, dots, n);
    for (uint32_t i = 0; i < n; i++)
        cn_chart_circle(chart, dots[i].x, dots[i].y, dots[i].radius,
                        &(cn_paint){ .fill = dots[i].on ? FRONT : "#999", .opacity = 0.55, .stroke = "#fff" });
    for (uint32_t i = 0; i < n; i++) {
        const dot *d = &dots[i];
        const cn_letters letters = letters_of(d);
        const double x = fmin(fmax(d->x, d->label.x0), d->label.x1), y = fmin(fmax(d->y, d->label.y0), d->label.y1);
        /* A line connects a dot with a name that is far from it. */
        if (hypot(x - d->x, y - d->y) > d->radius + 10)
            cn_chart_line(chart, &(cn_box){ d->x, d->y, x, y }, &(cn_paint){ .stroke = "#bbb" });
        cn_labels_draw(chart, &d->label, &letters, d->name);
    }
}

static void draw_legend(const cn_chart *chart, double y, double least, double most)
{
    const cn_legend front = { .text = "Pareto front: nothing tried is both quicker and better",
                              .paint = { .stroke = FRONT, .width = 2 } };
    double x = cn_chart_legend(chart, 80, y, &front);
    for (int k = 0; k < 2; k++) {
        const double bytes = k ? most : least;
        char text[48];
        snprintf(text, sizeof text, "%.0f MB", bytes / 1e6);
        const cn_legend size = { .sign = CN_SIGN_DOT,
                                 .radius = radius_of(bytes, most),
                                 .paint = { .fill = "#999", .opacity = 0.55 },
                                 .text = text };
        x = cn_chart_legend(chart, x, y, &size);
    }
}

/* A page of panels, with a legend at its foot. */
static cn_status draw_page(const cn_tradeoff *t, const cn_chart_page *page, const panel *panels, uint32_t n,
                           const char *path)
{
    double least = INFINITY, most = 1;
    cn_chart chart;
    CN_TRY(cn_chart_open(&chart));
    cn_chart_text(&chart, LEFT, 32, &title, page->title);
    cn_chart_text(&chart, LEFT, 54, &about, "a dot is a training; its size is the memory of training");
    for (uint32_t i = 0; i < t->n; i++) {
        least = fmin(least, t->rows[i].bytes);
        most = fmax(most, t->rows[i].bytes);
    }
    for (uint32_t i = 0; i < n; i++) {
        const cn_plot plot = plot_of(t, &panels[i]);
        dot dots[MOST_DOTS];
        const uint32_t n_dots = place_dots(&plot, t, most, &panels[i], dots);
        cn_plot_frame(&chart, &plot);
        draw_dots(&chart, dots, n_dots);
    }
    draw_legend(&chart, page->height - 20, least, most);
    cn_chart_page longer = *page;
    for (uint32_t i = 0; i < t->n; i++) {
        char text[288];
        if (!t->rows[i].why[0]) continue;
        snprintf(text, sizeof text, "%s lacks: %s", t->rows[i].name, t->rows[i].why);
        cn_chart_text(&chart, 80, longer.height + 4, &about, text);
        longer.height += 18;
    }
    return cn_chart_save(&chart, &longer, path);
}

cn_status cn_tradeoff_draw_front(const cn_tradeoff *t, const char *path)
{
    const cn_chart_page page = { "What accuracy costs in time", 1060, 560 };
    const figure *psnr = t->fitted ? &FITTED : &PSNR;
    const panel panels[] = { { { 80, 100, 510, 470 }, &TRAINING, psnr },
                             { { 600, 100, 1030, 470 }, &RENDERING, psnr } };
    return draw_page(t, &page, panels, 2, path);
}

double cn_tradeoff_db(const cn_tradeoff *t, const cn_tradeoff_row *row)
{
    return t->fitted ? row->half_psnr : row->psnr;
}

void cn_tradeoff_say_why(cn_tradeoff *t)
{
    const double far_db = 1.5;
    const cn_tradeoff_row *best = t->rows;
    for (uint32_t i = 1; i < t->n; i++)
        if (cn_tradeoff_db(t, &t->rows[i]) > cn_tradeoff_db(t, best)) best = &t->rows[i];
    for (uint32_t i = 0; i < t->n; i++) {
        cn_tradeoff_row *r = &t->rows[i];
        const double db = cn_tradeoff_db(t, r), best_db = cn_tradeoff_db(t, best);
        const double fall = r->train_psnr - db, best_fall = best->train_psnr - best_db;
        const bool slow = r->train_psnr<best->train_psnr - far_db, alone = fall> best_fall + far_db;
        if (!(db < best_db - far_db) || !(slow || alone)) continue;
        char steps[96] = "", photos[96] = "";
        if (slow)
            cn_print(steps, sizeof steps,
                     "its training photos are at %.1f dB, those of %s at %.1f: more steps or a larger field",
                     r->train_psnr, best->name, best->train_psnr);
        if (alone)
            cn_print(photos, sizeof photos, "held-out photos are %.1f dB below them, with %s %.1f: more photos", fall,
                     best->name, best_fall);
        snprintf(r->why, sizeof r->why, "%s%s%s", steps, slow && alone ? "; " : "", photos);
    }
}

cn_status cn_tradeoff_draw_fields(const cn_tradeoff *t, const char *path)
{
    const cn_chart_page page = { "What each kind of field costs and gives", 1280, 900 };
    const figure *psnr = t->fitted ? &FITTED : &PSNR;
    panel panels[6] = { { { 80, 100, 420, 400 }, &TRAINING, psnr },
                        { { 500, 100, 840, 400 }, &TRAINING, &SSIM },
                        { { 80, 500, 420, 800 }, &DISK, psnr },
                        { { 500, 500, 840, 800 }, &DISK, &SSIM },
                        { { 920, 500, 1260, 800 }, &RENDERING, psnr } };
    uint32_t n = 5;
    for (uint32_t i = 0; i < t->n && n == 5; i++)
        if (isfinite(t->rows[i].depth_error_m)) panels[n++] = (panel){ { 920, 100, 1260, 400 }, &TRAINING, &DEPTH };
    return draw_page(t, &page, panels, n, path);
}
