/* Charts of what the benchmarks measured. usage: bench_chart kernels KERNELS.csv OUT.svg, of bench_field's table: one
 * bar a kernel and instruction set; or: bench_chart scale SCALE.csv OUT.svg LIMIT_S LIMIT_MB, of scale.py's table;
 * or: bench_chart poses POSE_SCALE.csv OUT.svg LIMIT_S LIMIT_MB LIMIT_M, of pose_scale.py's. */
#include "base/file.h"
#include "base/number.h"
#include "chart/axis.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { COLUMNS = 24, ROWS = 512 };

/* A table whose cells have neither quotes nor commas. */
typedef struct table {
    char *text, *names[COLUMNS], *cells[ROWS][COLUMNS];
    uint32_t n_columns, n_rows;
} table;

static uint32_t split(char *line, char *cells[COLUMNS])
{
    uint32_t n = 0;
    line[strcspn(line, "\r")] = '\0';
    for (char *cell; n < COLUMNS && (cell = strsep(&line, ","));)
        cells[n++] = cell;
    return n;
}

static cn_status read_table(table *t, const char *path)
{
    size_t size;
    CN_TRY(cn_file_read(path, 0, &t->text, &size));
    char *rest = t->text, *line = strsep(&rest, "\n");
    t->n_columns = split(line, t->names);
    while (t->n_rows < ROWS && (line = strsep(&rest, "\n")) && *line)
        if (split(line, t->cells[t->n_rows++]) != t->n_columns)
            return cn_fail(CN_ERR_FORMAT, "%s: row %u has not as many cells as the first", path, t->n_rows);
    return CN_OK;
}

static cn_status find_column(const table *t, const char *name, uint32_t *column)
{
    for (*column = 0; *column < t->n_columns; ++*column)
        if (strcmp(t->names[*column], name) == 0) return CN_OK;
    return cn_fail(CN_ERR_FORMAT, "the table has no column '%s'", name);
}

static double number(const table *t, uint32_t row, uint32_t column)
{
    return cn_parse_double(t->cells[row][column], NULL);
}

/* ---- kernels ---- */

enum { BAR_ROW = 18, TOP = 60, SETS = 16 };

/* Instruction sets get colours in the order in which they come. */
static uint32_t number_of_set(const char *name, const char *sets[SETS], uint32_t *n)
{
    uint32_t i = 0;
    while (i < *n && strcmp(sets[i], name) != 0)
        i++;
    if (i == *n && *n < SETS) sets[(*n)++] = name;
    return i;
}

static cn_status draw_kernels(const table *t, const char *path)
{
    uint32_t kernel, set, ns, limit, share, n_sets = 0;
    const char *sets[SETS];
    cn_axis axis = cn_axis_from(270, 690);
    cn_chart chart;
    CN_TRY(find_column(t, "kernel", &kernel));
    CN_TRY(find_column(t, "set", &set));
    CN_TRY(find_column(t, "ns_per_sample", &ns));
    CN_TRY(find_column(t, "limit", &limit));
    CN_TRY(find_column(t, "share", &share));
    CN_TRY(cn_chart_open(&chart));
    cn_axis_include(&axis, 0);
    cn_axis_include(&axis, 1);
    for (uint32_t i = 0; i < t->n_rows; i++)
        cn_axis_include(&axis, number(t, i, share));
    const double hundred = cn_axis_at(&axis, 1), bottom = TOP + BAR_ROW * (double)t->n_rows;
    for (uint32_t i = 0; i < t->n_rows; i++) {
        const double y = TOP + BAR_ROW * (i + 0.5), value = number(t, i, share);
        char text[160];
        snprintf(text, sizeof text, "%s, %s", t->cells[i][kernel], t->cells[i][set]);
        cn_chart_text(&chart, axis.start - 6, y + 4, &(cn_letters){ .size = 12, .anchor = CN_ANCHOR_END }, text);
        cn_chart_bar(&chart, &axis, value, y, cn_chart_colour(number_of_set(t->cells[i][set], sets, &n_sets)));
        snprintf(text, sizeof text, "%.0f %% of %s, %.2f ns", 100 * value, t->cells[i][limit], number(t, i, ns));
        cn_chart_text(&chart, axis.end + 12, y + 4, &(cn_letters){ .size = 12 }, text);
    }
    cn_chart_line(&chart, &(cn_box){ hundred, TOP - 4, hundred, bottom },
                  &(cn_paint){ .stroke = CN_CHART_INK, .dashed = true });
    cn_chart_text(&chart, 10, 20, &(cn_letters){ .size = 14 },
                  "Share of the limit that binds each kernel, measured in the same run (dashed: the limit)");
    double x = axis.start;
    for (uint32_t i = 0; i < n_sets; i++)
        x = cn_chart_legend(
            &chart, x, 44,
            &(cn_legend){ .sign = CN_SIGN_BAR, .paint = { .fill = cn_chart_colour(i) }, .text = sets[i] });
    return cn_chart_save(&chart, &(cn_chart_page){ "Kernels beside their limits", 960, bottom + 16 }, path);
}

/* ---- planning by number of photos ---- */

typedef struct series {
    const char *column, *text;
} series;

static cn_status draw_panel(const cn_chart *chart, const table *t, cn_plot *plot, const series *of, uint32_t n,
                            double limit)
{
    static double xy[3][ROWS][2];
    uint32_t photos;
    CN_TRY(find_column(t, "photos", &photos));
    plot->x_title = "photos";
    plot->x.logarithmic = plot->y.logarithmic = plot->y.ends_at_ticks = true;
    cn_axis_include(&plot->y, limit);
    for (uint32_t k = 0; k < n; k++) {
        uint32_t column;
        CN_TRY(find_column(t, of[k].column, &column));
        for (uint32_t i = 0; i < t->n_rows; i++) {
            xy[k][i][0] = number(t, i, photos), xy[k][i][1] = fmax(number(t, i, column), 1e-3);
            cn_axis_include(&plot->x, xy[k][i][0]);
            cn_axis_include(&plot->y, xy[k][i][1]);
        }
    }
    cn_axis_fit(&plot->x, 0);
    cn_axis_fit(&plot->y, 0);
    cn_plot_frame(chart, plot);
    char text[48];
    snprintf(text, sizeof text, "limit: %g", limit);
    cn_plot_limit(chart, plot, limit, text);
    double x = plot->x.start;
    for (uint32_t k = 0; k < n; k++) {
        cn_plot_curve(chart, plot, (const double(*)[2])xy[k], t->n_rows, cn_chart_colour(k));
        x = cn_chart_legend(chart, x, plot->y.start + 66,
                            &(cn_legend){ .paint = { .stroke = cn_chart_colour(k), .width = 2 }, .text = of[k].text });
    }
    return CN_OK;
}

static cn_status draw_scale(const table *t, const char *path, double limit_s, double limit_mb)
{
    static const series times[] = { { "total_s", "plan and save" },
                                    { "tie_s", "tie views" },
                                    { "cpu_s", "processor time of both" } };
    static const series sizes[] = { { "peak_mb", "peak, poses included" }, { "input_mb", "poses, points, photos" } };
    cn_plot time = { .x = cn_axis_from(70, 490), .y = cn_axis_from(360, 60), .y_title = "Time, s" };
    cn_plot size = { .x = cn_axis_from(600, 1020), .y = cn_axis_from(360, 60), .y_title = "Memory, MB" };
    cn_chart chart;
    CN_TRY(cn_chart_open(&chart));
    cn_status status = draw_panel(&chart, t, &time, times, 3, limit_s);
    if (status == CN_OK) status = draw_panel(&chart, t, &size, sizes, 2, limit_mb);
    if (status == CN_OK)
        status = cn_chart_save(&chart, &(cn_chart_page){ "Planning by number of photos", 1060, 450 }, path);
    cn_chart_discard(&chart);
    return status;
}

/* ---- poses in groups by number of photos ---- */

static cn_status draw_poses(const table *t, const char *path, const double limits[3])
{
    static const series times[] = { { "total_s", "split, join and adjust" }, { "cpu_s", "processor time" } };
    static const series sizes[] = { { "peak_mb", "peak, models included" }, { "models_mb", "models of the groups" } };
    static const series errors[] = { { "rms_m", "on Earth, by GPS of 1 m" }, { "fit_rms_m", "after the best fit" } };
    cn_plot time = { .x = cn_axis_from(70, 490), .y = cn_axis_from(360, 60), .y_title = "Time, s" };
    cn_plot size = { .x = cn_axis_from(600, 1020), .y = cn_axis_from(360, 60), .y_title = "Memory, MB" };
    cn_plot error = { .x = cn_axis_from(1130, 1550), .y = cn_axis_from(360, 60), .y_title = "Error of cameras, m rms" };
    cn_chart chart;
    CN_TRY(cn_chart_open(&chart));
    cn_status status = draw_panel(&chart, t, &time, times, 2, limits[0]);
    if (status == CN_OK) status = draw_panel(&chart, t, &size, sizes, 2, limits[1]);
    if (status == CN_OK) status = draw_panel(&chart, t, &error, errors, 2, limits[2]);
    if (status == CN_OK)
        status = cn_chart_save(&chart, &(cn_chart_page){ "Merging groups by number of photos", 1590, 450 }, path);
    cn_chart_discard(&chart);
    return status;
}

int main(int argc, char **argv)
{
    static table t;
    cn_status status = CN_OK;
    const bool kernels = argc == 4 && strcmp(argv[1], "kernels") == 0;
    const bool scale = argc == 6 && strcmp(argv[1], "scale") == 0;
    const bool poses = argc == 7 && strcmp(argv[1], "poses") == 0;
    double limits[3] = { 0 };
    if (!kernels && !scale && !poses) {
        fputs("usage: bench_chart kernels KERNELS.csv OUT.svg\n"
              "       bench_chart scale SCALE.csv OUT.svg LIMIT_S LIMIT_MB\n"
              "       bench_chart poses POSE_SCALE.csv OUT.svg LIMIT_S LIMIT_MB LIMIT_M\n",
              stderr);
        return 2;
    }
    status = read_table(&t, argv[2]);
    for (int i = 4; i < argc; i++)
        limits[i - 4] = cn_parse_double(argv[i], NULL);
    if (status == CN_OK)
        status = kernels ? draw_kernels(&t, argv[3])
                 : poses ? draw_poses(&t, argv[3], limits)
                         : draw_scale(&t, argv[3], limits[0], limits[1]);
    if (status != CN_OK) fprintf(stderr, "bench_chart: %s\n", cn_error_message());
    free(t.text);
    return status == CN_OK ? 0 : 1;
}
