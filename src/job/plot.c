#include "job/plot.h"

#include "base/file.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define FONT "font-family=\"sans-serif\""

/* An SVG file in memory, written whole at the end. */
typedef struct sheet { char *text; size_t size; FILE *out; } sheet;

static cn_status sheet_open(sheet *s, int width, int height, const char *title)
{
    *s = (sheet){0};
    s->out = open_memstream(&s->text, &s->size);
    if (!s->out) return cn_fail(CN_ERR_NOMEM, "out of memory for a plot");
    fprintf(s->out, "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"%d\" height=\"%d\" viewBox=\"0 0 %d %d\">\n"
                    "<rect width=\"%d\" height=\"%d\" fill=\"white\"/>\n"
                    "<text x=\"24\" y=\"32\" " FONT " font-size=\"18\" fill=\"#222\">%s</text>\n",
            width, height, width, height, width, height, title);
    return CN_OK;
}

static cn_status sheet_save(sheet *s, const char *path)
{
    fprintf(s->out, "</svg>\n");
    const bool bad = fclose(s->out) != 0;
    const cn_status status = bad ? cn_fail(CN_ERR_NOMEM, "out of memory for %s", path) : cn_file_write(path, s->text, s->size);
    free(s->text);
    return status;
}

static void label(const sheet *s, double x, double y, const char *anchor, int size, const char *colour, const char *text)
{
    fprintf(s->out, "<text x=\"%.1f\" y=\"%.1f\" text-anchor=\"%s\" " FONT " font-size=\"%d\" fill=\"%s\">%s</text>\n", x, y, anchor, size, colour, text);
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
    fprintf(s->out, "<rect x=\"%.1f\" y=\"%.1f\" width=\"%.1f\" height=\"16\" fill=\"%s\"/>\n", length < 0 ? zero + length : zero, y, fabs(length), colour);
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
    label(&s, 24, 54, "start", 12, "#666", "held-out PSNR, right half fitted on the left, and training time: with the effect, less without it");
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
        if (i != row && other <= time && t->rows[i].psnr >= t->rows[row].psnr && (other < time || t->rows[i].psnr > t->rows[row].psnr)) return false;
    }
    return true;
}

typedef struct axes { double x0, y0, width, height, low_log, high_log, low_db, high_db; bool render; } axes;

static double time_of(const cn_tradeoff_row *r, bool render) { return fmax(render ? r->render_s : r->train_s, 1e-3); }
static double place_x(const axes *a, double time) { return a->x0 + a->width * (log10(time) - a->low_log) / (a->high_log - a->low_log); }
static double place_y(const axes *a, double db) { return a->y0 + a->height * (1 - (db - a->low_db) / (a->high_db - a->low_db)); }

static axes fit_axes(const cn_tradeoff *t, double x0, bool render)
{
    axes a = {x0, 90, 430, 380, INFINITY, -INFINITY, INFINITY, -INFINITY, render};
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
    fprintf(s->out, "<rect x=\"%.1f\" y=\"%.1f\" width=\"%.1f\" height=\"%.1f\" fill=\"none\" stroke=\"#999\"/>\n", a->x0, a->y0, a->width, a->height);
    label(s, a->x0 + a->width / 2, a->y0 - 12, "middle", 13, "#222", a->render ? "rendering and scoring, s a photo" : "training, s");
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

static void draw_points(const sheet *s, const axes *a, const cn_tradeoff *t)
{
    double front[64][2], most = 1;
    uint32_t n = 0;
    for (uint32_t i = 0; i < t->n; i++) most = fmax(most, t->rows[i].bytes);
    for (uint32_t i = 0; i < t->n && n < 64; i++)
        if (cn_plot_on_front(t, i, a->render)) front[n][0] = place_x(a, time_of(&t->rows[i], a->render)), front[n++][1] = place_y(a, t->rows[i].psnr);
    qsort(front, n, sizeof *front, by_time);
    for (uint32_t i = 0; i < n; i++) fprintf(s->out, "%s%.1f %.1f", i ? "L" : "<path fill=\"none\" stroke=\"#2a5fa8\" stroke-width=\"2\" d=\"M", front[i][0], front[i][1]);
    if (n) fprintf(s->out, "\"/>\n");
    for (uint32_t i = 0; i < t->n; i++) {
        const bool on = cn_plot_on_front(t, i, a->render);
        const double x = place_x(a, time_of(&t->rows[i], a->render)), y = place_y(a, t->rows[i].psnr);
        fprintf(s->out, "<circle cx=\"%.1f\" cy=\"%.1f\" r=\"%.1f\" fill=\"%s\" fill-opacity=\"0.55\" stroke=\"white\"/>\n", x, y, 3 + 9 * sqrt(t->rows[i].bytes / most),
                on ? "#2a5fa8" : "#999");
        label(s, x, y - 12, "middle", on ? 11 : 9, on ? "#1d3f73" : "#888", t->rows[i].name);
    }
}

cn_status cn_plot_front(const cn_tradeoff *t, const char *path)
{
    sheet s;
    CN_TRY(sheet_open(&s, 1060, 530, "What accuracy costs in time"));
    label(&s, 24, 54, "start", 12, "#666", "held-out PSNR; a dot's area is the memory of training; the line joins what nothing else beats");
    for (int render = 0; render < 2; render++) {
        const axes a = fit_axes(t, render ? 600 : 80, render);
        draw_axes(&s, &a);
        draw_points(&s, &a, t);
    }
    return sheet_save(&s, path);
}
