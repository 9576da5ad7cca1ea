#include "chart/tradeoff.h"

#include "base/file.h"
#include "base/number.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define FONT "font-family=\"sans-serif\""
#define FRONT "#2a5fa8"

/* An SVG file in memory, written whole at the end. */
typedef struct sheet {
    locale_t before; /* the caller's: a chart has dots */
    char *text;
    size_t size;
    FILE *out;
} sheet;

static cn_status sheet_open(sheet *s, int width, int height, const char *title)
{
    *s = (sheet){ 0 };
    s->out = open_memstream(&s->text, &s->size);
    if (!s->out) return cn_fail(CN_ERR_NOMEM, "out of memory for a plot");
    s->before = cn_number_begin();
    fprintf(s->out,
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"%d\" height=\"%d\" viewBox=\"0 0 %d %d\">\n"
            "<rect width=\"%d\" height=\"%d\" fill=\"white\"/>\n"
            "<text x=\"24\" y=\"32\" " FONT " font-size=\"18\" fill=\"#222\">%s</text>\n",
            width, height, width, height, width, height, title);
    return CN_OK;
}

static cn_status sheet_save(sheet *s, const char *path)
{
    fprintf(s->out, "</svg>\n");
    cn_number_end(s->before);
    const bool bad = fclose(s->out) != 0;
    const cn_status status =
        bad ? cn_fail(CN_ERR_NOMEM, "out of memory for %s", path) : cn_file_write(path, s->text, s->size);
    free(s->text);
    return status;
}

static void label(const sheet *s, double x, double y, const char *anchor, int size, const char *colour,
                  const char *text)
{
    fprintf(s->out,
            "<text x=\"%.1f\" y=\"%.1f\" text-anchor=\"%s\" " FONT
            " font-size=\"%d\" fill=\"%s\" stroke=\"white\" stroke-width=\"3\" "
            "paint-order=\"stroke\">%s</text>\n",
            x, y, anchor, size, colour, text);
}

/* ---- bars of effects ---- */

/* dB and seconds that the effect of a row adds when it is on. */
static void worth(const cn_tradeoff *t, uint32_t i, double *db, double *seconds)
{
    const cn_tradeoff_row *planned = &t->rows[0], *turned = &t->rows[i];
    const double sign = strncmp(turned->name, "without", 7) == 0 ? 1 : -1;
    *db = sign * (planned->half_psnr - turned->half_psnr);
    *seconds = sign * (planned->train_s - turned->train_s);
}

static void bar(const sheet *s, double zero, double y, double length, const char *colour)
{
    fprintf(s->out, "<rect x=\"%.1f\" y=\"%.1f\" width=\"%.1f\" height=\"16\" fill=\"%s\"/>\n",
            length < 0 ? zero + length : zero, y, fabs(length), colour);
}

cn_status cn_plot_effects(const cn_tradeoff *t, const char *path)
{
    double most_db = 0.1, most_s = 1, db, seconds;
    for (uint32_t i = 1; i < t->n; i++) {
        worth(t, i, &db, &seconds);
        most_db = fmax(most_db, fabs(db));
        most_s = fmax(most_s, fabs(seconds));
    }
    sheet s;
    CN_TRY(sheet_open(&s, 860, 120 + 34 * (int)t->n, "What each effect is worth"));
    label(&s, 24, 54, "start", 12, "#666",
          "held-out PSNR, right half fitted on the left, and training time: with the effect, less without it");
    label(&s, 380, 84, "middle", 12, "#222", "dB gained");
    label(&s, 680, 84, "middle", 12, "#222", "seconds paid");
    for (uint32_t i = 1; i < t->n; i++) {
        const double y = 100 + 34 * (double)(i - 1);
        const bool on = strncmp(t->rows[i].name, "without", 7) == 0;
        char text[96];
        worth(t, i, &db, &seconds);
        snprintf(text, sizeof text, "%s (%s)", strchr(t->rows[i].name, '-') + 1, on ? "on" : "off");
        label(&s, 230, y + 13, "end", 13, "#222", text);
        bar(&s, 380, y, 100 * db / most_db, db >= 0 ? "#2a7f4f" : "#b3001b");
        bar(&s, 680, y, 100 * seconds / most_s, "#8a6d1b");
        snprintf(text, sizeof text, "%+.2f dB", db);
        label(&s, 500, y + 13, "start", 12, "#222", text);
        snprintf(text, sizeof text, "%+.0f s", seconds);
        label(&s, 800, y + 13, "start", 12, "#222", text);
    }
    return sheet_save(&s, path);
}

/* ---- the front ---- */

bool cn_plot_on_front(const cn_tradeoff *t, uint32_t row, bool render)
{
    const double time = render ? t->rows[row].render_s : t->rows[row].train_s;
    for (uint32_t i = 0; i < t->n; i++) {
        const double other = render ? t->rows[i].render_s : t->rows[i].train_s;
        if (i != row && other <= time && t->rows[i].psnr >= t->rows[row].psnr &&
            (other < time || t->rows[i].psnr > t->rows[row].psnr))
            return false;
    }
    return true;
}

typedef struct axes {
    double x0, y0, width, height, low_log, high_log, low_db, high_db;
    bool render;
} axes;

static double time_of(const cn_tradeoff_row *r, bool render)
{
    return fmax(render ? r->render_s : r->train_s, 1e-3);
}
static double place_x(const axes *a, double time)
{
    return a->x0 + a->width * (log10(time) - a->low_log) / (a->high_log - a->low_log);
}
static double place_y(const axes *a, double db)
{
    return a->y0 + a->height * (1 - (db - a->low_db) / (a->high_db - a->low_db));
}

static axes fit_axes(const cn_tradeoff *t, double x0, bool render)
{
    axes a = { x0, 90, 430, 380, INFINITY, -INFINITY, INFINITY, -INFINITY, render };
    for (uint32_t i = 0; i < t->n; i++) {
        const double time = log10(time_of(&t->rows[i], render));
        a.low_log = fmin(a.low_log, time), a.high_log = fmax(a.high_log, time);
        a.low_db = fmin(a.low_db, t->rows[i].psnr), a.high_db = fmax(a.high_db, t->rows[i].psnr);
    }
    a.low_log -= 0.1, a.high_log += 0.15;
    a.low_db = floor(a.low_db - 0.2), a.high_db = ceil(a.high_db + 0.2);
    return a;
}

static void draw_axes(const sheet *s, const axes *a)
{
    char text[32];
    fprintf(s->out, "<rect x=\"%.1f\" y=\"%.1f\" width=\"%.1f\" height=\"%.1f\" fill=\"none\" stroke=\"#999\"/>\n",
            a->x0, a->y0, a->width, a->height);
    label(s, a->x0 + a->width / 2, a->y0 - 12, "middle", 13, "#222",
          a->render ? "rendering, s a photo" : "training, s");
    for (double db = a->low_db; db <= a->high_db + 1e-6; db += a->high_db - a->low_db > 8 ? 2 : 1) {
        snprintf(text, sizeof text, "%.0f dB", db);
        label(s, a->x0 - 6, place_y(a, db) + 4, "end", 11, "#444", text);
        fprintf(s->out, "<path d=\"M%.1f %.1fh%.1f\" stroke=\"#eee\"/>\n", a->x0, place_y(a, db), a->width);
    }
    for (double decade = floor(a->low_log); decade <= a->high_log; decade++)
        for (int k = 1; k < 10; k += k == 1 ? 1 : k == 2 ? 3 : 5) {
            const double time = k * pow(10, decade);
            if (log10(time) < a->low_log || log10(time) > a->high_log) continue;
            snprintf(text, sizeof text, "%g", time);
            label(s, place_x(a, time), a->y0 + a->height + 16, "middle", 11, "#444", text);
            fprintf(s->out, "<path d=\"M%.1f %.1fv%.1f\" stroke=\"#eee\"/>\n", place_x(a, time), a->y0, a->height);
        }
}

static int by_time(const void *x, const void *y)
{
    const double a = ((const double *)x)[0], b = ((const double *)y)[0];
    return (a > b) - (a < b);
}

/* Where a point stands, and where its name goes. Boxes are left, top, right, bottom. */
typedef struct dot {
    double x, y, radius;
    bool on;
    double box[4];
} dot;
enum { MOST_DOTS = 64, SPOTS = 24 };

static bool overlap(const double a[4], const double b[4])
{
    return a[0] < b[2] && b[0] < a[2] && a[1] < b[3] && b[1] < a[3];
}

static int letters_px(const dot *d)
{
    return d->on ? 12 : 10;
}

/* The k-th place to try for a name: above, below, to either side, then farther out. */
static void spot(const dot *d, const char *name, int k, double box[4])
{
    static const double across[8] = { 0, 0, 1, -1, 1, -1, 1, -1 }, down[8] = { -1, 1, 0, 0, -1, -1, 1, 1 };
    const double width = 0.56 * letters_px(d) * (double)strlen(name), height = letters_px(d) + 2,
                 gap = d->radius + 2 + 12 * (k / 8);
    const double x = d->x + across[k % 8] * (0.5 * width + gap),
                 y = d->y + down[k % 8] * (0.5 * height + gap * (across[k % 8] != 0 ? 0.6 : 1));
    box[0] = x - 0.5 * width, box[1] = y - 0.5 * height, box[2] = x + 0.5 * width, box[3] = y + 0.5 * height;
}

/* How bad a place is: other names weigh most, then the axes' ends, then dots. */
static double harm(const axes *a, const dot *dots, uint32_t n, uint32_t i, const bool *named, const double box[4])
{
    double sum = 0;
    for (uint32_t k = 0; k < n; k++) {
        const dot *d = &dots[k];
        const double disc[4] = { d->x - d->radius, d->y - d->radius, d->x + d->radius, d->y + d->radius };
        if (named[k] && overlap(box, d->box)) sum += 10;
        if (k != i && overlap(box, disc)) sum += 3;
    }
    if (box[0] < a->x0 || box[2] > a->x0 + a->width || box[1] < a->y0 || box[3] > a->y0 + a->height) sum += 8;
    return sum;
}

/* Those on the front choose first. */
static void place_names(const axes *a, const cn_tradeoff *t, dot *dots, uint32_t n)
{
    bool named[MOST_DOTS] = { false };
    for (int turn = 0; turn < 2; turn++)
        for (uint32_t i = 0; i < n; i++) {
            double least = INFINITY;
            if (dots[i].on != (turn == 0)) continue;
            for (int k = 0; k < SPOTS; k++) {
                double box[4];
                spot(&dots[i], t->rows[i].name, k, box);
                const double bad = harm(a, dots, n, i, named, box) + 0.01 * k;
                if (bad < least) least = bad, memcpy(dots[i].box, box, sizeof box);
            }
            named[i] = true;
        }
}

static uint32_t place_dots(const axes *a, const cn_tradeoff *t, double most, dot dots[MOST_DOTS])
{
    uint32_t n = 0;
    for (; n < t->n && n < MOST_DOTS; n++) {
        const cn_tradeoff_row *r = &t->rows[n];
        dots[n] = (dot){ .x = place_x(a, time_of(r, a->render)),
                         .y = place_y(a, r->psnr),
                         .radius = 3 + 9 * sqrt(r->bytes / most),
                         .on = cn_plot_on_front(t, n, a->render) };
    }
    place_names(a, t, dots, n);
    return n;
}

static void draw_front(const sheet *s, const dot *dots, uint32_t n)
{
    double front[MOST_DOTS][2];
    uint32_t m = 0;
    for (uint32_t i = 0; i < n; i++)
        if (dots[i].on) front[m][0] = dots[i].x, front[m++][1] = dots[i].y;
    qsort(front, m, sizeof *front, by_time);
    for (uint32_t i = 0; i < m; i++)
        fprintf(s->out, "%s%.1f %.1f", i ? "L" : "<path fill=\"none\" stroke=\"" FRONT "\" stroke-width=\"2\" d=\"M",
                front[i][0], front[i][1]);
    if (m) fprintf(s->out, "\"/>\n");
}

static void draw_points(const sheet *s, const axes *a, const cn_tradeoff *t, double most)
{
    dot dots[MOST_DOTS];
    const uint32_t n = place_dots(a, t, most, dots);
    draw_front(s, dots, n);
    for (uint32_t i = 0; i < n; i++)
        fprintf(s->out,
                "<circle cx=\"%.1f\" cy=\"%.1f\" r=\"%.1f\" fill=\"%s\" fill-opacity=\"0.55\" stroke=\"white\"/>\n",
                dots[i].x, dots[i].y, dots[i].radius, dots[i].on ? FRONT : "#999");
    for (uint32_t i = 0; i < n; i++) {
        const double *b = dots[i].box, x = 0.5 * (b[0] + b[2]), y = 0.5 * (b[1] + b[3]);
        /* A name that had to go far away is tied to its dot. */
        if (hypot(x - dots[i].x, y - dots[i].y) > dots[i].radius + 0.5 * (b[2] - b[0]) + 10)
            fprintf(s->out, "<path d=\"M%.1f %.1fL%.1f %.1f\" stroke=\"#bbb\"/>\n", dots[i].x, dots[i].y, x, y);
        label(s, x, b[3] - 3, "middle", letters_px(&dots[i]), dots[i].on ? "#1d3f73" : "#777", t->rows[i].name);
    }
}

static void draw_legend(const sheet *s, double x, double y, double least, double most)
{
    char text[48];
    fprintf(s->out, "<path d=\"M%.1f %.1fh28\" stroke=\"" FRONT "\" stroke-width=\"2\"/>\n", x, y - 4);
    label(s, x + 36, y, "start", 12, "#222", "Pareto front: nothing tried is both quicker and better");
    for (int k = 0; k < 2; k++) {
        const double bytes = k ? most : least, at = x + 400 + 130 * k;
        fprintf(s->out, "<circle cx=\"%.1f\" cy=\"%.1f\" r=\"%.1f\" fill=\"#999\" fill-opacity=\"0.55\"/>\n", at, y - 4,
                3 + 9 * sqrt(bytes / most));
        snprintf(text, sizeof text, "%.0f MB", bytes / 1e6);
        label(s, at + 18, y, "start", 12, "#222", text);
    }
}

cn_status cn_plot_front(const cn_tradeoff *t, const char *path)
{
    double least = INFINITY, most = 1;
    sheet s;
    CN_TRY(sheet_open(&s, 1060, 560, "What accuracy costs in time"));
    label(&s, 24, 54, "start", 12, "#666",
          "held-out PSNR; one setting changed at a time; a dot's size is the memory of training");
    for (uint32_t i = 0; i < t->n; i++) {
        least = fmin(least, t->rows[i].bytes);
        most = fmax(most, t->rows[i].bytes);
    }
    for (int render = 0; render < 2; render++) {
        const axes a = fit_axes(t, render ? 600 : 80, render);
        draw_axes(&s, &a);
        draw_points(&s, &a, t, most);
    }
    draw_legend(&s, 80, 530, least, most);
    return sheet_save(&s, path);
}
