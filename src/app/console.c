#include "app.h"

#include "base/clock.h"
#include "conurb/device.h"

#include <stdio.h>
#include <string.h>
#include <sys/ioctl.h>
#include <unistd.h>

static bool terminal, line_open;
static double last_print;
/* What was last worked on; several devices take turns. */
enum { STAGES = CN_DEVICE_MAX };
static char last_stages[STAGES][64];

static bool is_fresh(const char *stage)
{
    static int next;
    for (int i = 0; i < STAGES; i++)
        if (strcmp(last_stages[i], stage) == 0) return false;
    snprintf(last_stages[next], sizeof last_stages[next], "%s", stage);
    next = (next + 1) % STAGES;
    return true;
}

static void close_line(void)
{
    if (line_open) fputc('\n', stderr);
    line_open = false;
}

static void print_log(void *user, cn_log_level level, const char *text)
{
    (void)user;
    if (level == CN_LOG_DEBUG) return;
    close_line();
    fprintf(stderr, "%s%s\n", level == CN_LOG_WARN ? "warning: " : level == CN_LOG_ERROR ? "error: " : "", text);
}

static void time_left(double s, char out[32])
{
    if (!(s >= 0))
        snprintf(out, 32, "?");
    else if (s < 90)
        snprintf(out, 32, "%.0f s", s);
    else if (s < 5400)
        snprintf(out, 32, "%.0f min", s / 60);
    else
        snprintf(out, 32, "%.1f h", s / 3600);
}

int cn_app_bar(double done, double total, char out[CN_APP_BAR + 1])
{
    const double ratio = total > 0 && done > 0 ? done / total : 0, share = ratio < 1 ? ratio : 1;
    memset(out, '.', CN_APP_BAR);
    memset(out, '#', (size_t)(CN_APP_BAR * share));
    out[CN_APP_BAR] = '\0';
    return (int)(100 * share);
}

/* Characters, not bytes. */
static size_t width_of(const char *text)
{
    size_t n = 0;
    for (; *text; text++)
        n += ((unsigned char)*text & 0xc0) != 0x80;
    return n;
}

/* One row of the terminal: of a longer line only the last row would be overwritten by the next. The bar goes first,
 * then the end. */
static void draw(const char *stage, const char *bar, const char *done, const char *left, const char *detail)
{
    struct winsize size = { 0 };
    char line[512];
    const bool known = ioctl(STDERR_FILENO, TIOCGWINSZ, &size) == 0 && size.ws_col > 1;
    const size_t most = known ? size.ws_col - 1u : sizeof line;
    snprintf(line, sizeof line, "%s [%s] %s, %s left  %s", stage, bar, done, left, detail);
    if (width_of(line) > most) snprintf(line, sizeof line, "%s %s, %s left  %s", stage, done, left, detail);
    char *end = line;
    for (size_t n = 0; *end; end++) {
        n += ((unsigned char)*end & 0xc0) != 0x80;
        if (n > most) break;
    }
    *end = '\0';
    fprintf(stderr, "\r\033[K%s", line);
}

static void print_progress(void *user, const cn_progress_report *r)
{
    (void)user;
    const double now = cn_now_s();
    const bool last = r->total > 0 && r->done >= r->total;
    char stage[64];
    snprintf(stage, sizeof stage, "%s%s%s", r->stage, r->item && *r->item ? " " : "", r->item ? r->item : "");
    const bool fresh = is_fresh(stage);
    if (!last && !fresh && now - last_print < (terminal ? 0.2 : 5)) return;
    last_print = now;
    char left[32];
    time_left(r->left_s, left);
    char bar[CN_APP_BAR + 1];
    const int percent = cn_app_bar(r->done, r->total, bar);
    const char *detail = r->detail ? r->detail : "";
    char done[64];
    if (r->total > 0)
        snprintf(done, sizeof done, "%d%%, %.0f of %.0f", percent, r->done, r->total);
    else
        snprintf(done, sizeof done, "%.0f", r->done);
    if (terminal) {
        if (fresh && line_open) fputc('\n', stderr);
        draw(stage, bar, done, left, detail);
        line_open = !last;
        if (last) fputc('\n', stderr);
        fflush(stderr);
    } else {
        fprintf(stderr, "%s: %s, %s left%s%s\n", stage, done, left, *detail ? ", " : "", detail);
    }
}

void cn_app_console(cn_context *ctx)
{
    terminal = isatty(STDERR_FILENO);
    ctx->log = print_log;
    ctx->progress = print_progress;
}
