/* poses/report.html: one file, readable in light and dark, without anything from another host. */
#include "base/file.h"
#include "base/number.h"
#include "geo/heights.h"
#include "pose/lens.h"
#include "pose/quality.h"
#include "pose/report_charts.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { MOST_ROWS = 500 };

static const char HEAD[] =
    "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><title>Poses</title>\n"
    "<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n"
    "<meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; style-src 'unsafe-inline'\">\n"
    "<style>\n"
    ":root { color-scheme: light dark; --ink: #222; --soft: #666; --line: #ddd; --page: #fff; --bad: #b3001b; }\n"
    "@media (prefers-color-scheme: dark) {\n"
    "  :root { --ink: #e6e6e6; --soft: #a0a0a0; --line: #3a3a3a; --page: #16181b; --bad: #ff7a85; }\n"
    "  svg { fill: var(--ink); }\n"
    "  svg [fill=\"#fff\"] { fill: var(--page); }\n"
    "  svg [fill=\"#222\"], svg [fill=\"#444\"], svg [fill=\"#666\"] { fill: var(--ink); }\n"
    "  svg [stroke=\"#fff\"] { stroke: var(--page); }\n"
    "  svg [stroke=\"#e4e4e4\"] { stroke: var(--line); }\n"
    "  svg [fill=\"#0072b2\"] { fill: #5ab0e6; } svg [fill=\"#a34f8f\"] { fill: #d993c9; }\n"
    "}\n"
    "body { margin: 2em auto; max-width: 900px; padding: 0 1em; font: 16px/1.5 system-ui, sans-serif;\n"
    "  color: var(--ink); background: var(--page); }\n"
    "h2 { margin-top: 2em; } svg { max-width: 100%; min-width: 620px; height: auto; }\n"
    "table { border-collapse: collapse; width: 100%; font-size: 14px; }\n"
    "th, td { text-align: right; padding: 3px 8px; border-bottom: 1px solid var(--line); }\n"
    "th:first-child, td:first-child, td.words, th.words { text-align: left; }\n"
    "th { position: sticky; top: 0; background: var(--page); }\n"
    "td:first-child { position: sticky; left: 0; background: var(--page); }\n"
    ".wide { overflow-x: auto; } .scroll { max-height: 420px; overflow: auto; } .soft { color: var(--soft); } .bad { "
    "color: var(--bad); }\n"
    "</style></head><body>\n<h1>Poses</h1>\n";

static void put(FILE *out, const char *text)
{
    for (; *text; text++)
        switch (*text) {
        case '<': fputs("&lt;", out); break;
        case '>': fputs("&gt;", out); break;
        case '&': fputs("&amp;", out); break;
        case '"': fputs("&quot;", out); break;
        default: fputc(*text, out);
        }
}

static void cell(FILE *out, double value, int digits)
{
    if (isfinite(value))
        fprintf(out, "<td>%.*f</td>", digits, value);
    else
        fputs("<td class=\"soft\">-</td>", out);
}

static void cell_text(FILE *out, const char *text)
{
    fputs("<td class=\"words\">", out);
    put(out, text);
    fputs("</td>", out);
}

static double length(const double v[3])
{
    return sqrt(v[0] * v[0] + v[1] * v[1] + (isfinite(v[2]) ? v[2] * v[2] : 0.0));
}

/* ---- in words ---- */

static void write_import(const cn_quality *q, FILE *out)
{
    const cn_import_verdict *v = &q->verdict;
    fputs("<p>Imported poses: ", out);
    put(out, q->import);
    if (v->n_gps) fprintf(out, "; %u of their %u photos with GPS agree with it", v->n_agree, v->n_gps);
    fputs(". ", out);
    switch (v->outcome) {
    case CN_IMPORT_UNCHECKED: fputs("They were not checked by GPS.", out); break;
    case CN_IMPORT_AGREES: fputs("They are used.", out); break;
    case CN_IMPORT_DOUBTFUL:
        fputs("<span class=\"bad\">They bend, or parts of them are joined wrongly; no other poses were found.</span>",
              out);
        break;
    case CN_IMPORT_KEPT:
        fprintf(out, "Poses were found anew, and %u photos agree with those: no better, so the import is used.",
                v->n_agree_anew);
        break;
    case CN_IMPORT_REPLACED:
        fprintf(out, "<b>Poses were found anew</b>, and %u photos agree with those, so they are used.",
                v->n_agree_anew);
        break;
    }
    fputs("</p>\n", out);
}

static void write_summary(const cn_quality *q, FILE *out)
{
    fprintf(out, "<p><b>%u of %u photos have a pose</b>, with %u sparse points.", q->scene->n_views,
            q->scene->n_views + q->n_missing, q->scene->n_points);
    if (isfinite(q->mean_error_px))
        fprintf(out, " A point lies on average %.2f px from where a photo shows it.", q->mean_error_px);
    fputs("</p>\n<p>Source: ", out);
    put(out, q->source);
    if (q->way) fprintf(out, ", attempt %u (%s)", q->attempt, q->way);
    if (q->grouped) fprintf(out, ", in %u groups", q->grouped->report.n_groups);
    fputs(".", out);
    if (q->n_models > 1) fprintf(out, " There were %u separate parts; the largest is used.", q->n_models);
    fputs("</p>\n", out);
    if (q->import) write_import(q, out);
    if (!q->frame->georeferenced) {
        fputs("<p>The poses have no place on Earth, and their unit is not the metre: fewer than three posed photos "
              "have GPS, and there are no control points.</p>\n",
              out);
        return;
    }
    fprintf(out, "<p>Place: %.6f, %.6f, %.1f m %s. ", q->frame->latitude_deg, q->frame->longitude_deg,
            q->frame->height_m, cn_frame_heights(q->frame));
    if (isfinite(q->off_rms_m[0]))
        fprintf(out,
                "%u of %u photos agree with their GPS; those are off by %.3f m to the east, %.3f m to the north and "
                "%.3f m in height (rms).",
                q->frame->n_inliers, q->frame->n_gps, q->off_rms_m[0], q->off_rms_m[1], q->off_rms_m[2]);
    fputs("</p>\n", out);
    if (q->frame->nadir_ambiguous)
        fputs("<p class=\"bad\">All photos look straight down on flat ground. There a longer lens from higher up gives "
              "the same pictures, so heights are uncertain. A few oblique photos, or control points, settle it.</p>\n",
              out);
}

static void write_control_rows(const cn_quality *q, FILE *out)
{
    for (uint32_t i = 0; i < q->fit->n_points; i++) {
        const cn_control_residual *r = &q->fit->points[i];
        fputs("<tr>", out);
        cell_text(out, q->control->points[i].name);
        cell_text(out, q->control->points[i].check ? "check" : "control");
        fprintf(out, "<td>%u</td>", r->n_views);
        for (int k = 0; k < 3; k++)
            cell(out, r->residual_m[k], 3);
        cell(out, r->measured ? length(r->residual_m) : NAN, 3);
        cell(out, isfinite(r->before_m[0]) ? length(r->before_m) : NAN, 3);
        cell(out, r->error_px, 2);
        fputs("</tr>\n", out);
    }
}

static void write_control(const cn_quality *q, FILE *out)
{
    fputs("<h2>Control and check points</h2>\n<p>", out);
    if (q->fit->n_check) {
        fprintf(out, "<b>Check points: %.3f m rms</b>", length(q->fit->check_rms_m));
        if (isfinite(q->fit->check_before_m[0]))
            fprintf(out, "; by the photos' GPS alone %.3f m", length(q->fit->check_before_m));
        fputs(". They took no part in the adjustment. ", out);
    }
    if (q->fit->n_control) fprintf(out, "Control points: %.3f m rms.", length(q->fit->control_rms_m));
    fputs("</p>\n<p class=\"soft\">Place by the photos minus surveyed place, in metres.</p>\n<div class=\"scroll\">"
          "<table><tr><th>point</th><th class=\"words\">use</th><th>photos</th><th>east</th><th>north</th><th>up</th>"
          "<th>distance</th><th>by GPS alone</th><th>marks, px</th></tr>\n",
          out);
    write_control_rows(q, out);
    fputs("</table></div>\n", out);
}

static void write_missing(const cn_quality *q, FILE *out)
{
    fputs("<h2>Photos without a pose</h2>\n", out);
    if (!q->n_missing) {
        fputs("<p>None.</p>\n", out);
        return;
    }
    fputs("<div class=\"scroll\"><table><tr><th>photo</th><th class=\"words\">why</th><th>features</th>"
          "<th>best matches</th><th>sharpness</th></tr>\n",
          out);
    for (uint32_t i = 0; i < q->n_missing && i < MOST_ROWS; i++) {
        const cn_missing_photo *m = &q->missing[i];
        fputs("<tr>", out);
        cell_text(out, q->index->photos[m->photo].name);
        cell_text(out, m->why);
        fprintf(out, "<td>%u</td><td>%u</td>", m->n_features, m->n_verified);
        cell(out, m->sharpness, 2);
        fputs("</tr>\n", out);
    }
    fputs("</table></div>\n", out);
    if (q->n_missing > MOST_ROWS)
        fprintf(out, "<p class=\"soft\">The first %d of %u; report.json has all.</p>\n", MOST_ROWS, q->n_missing);
}

static void write_cameras(const cn_quality *q, FILE *out)
{
    uint32_t rows = 0;
    fputs("<h2>Cameras</h2>\n<p class=\"soft\">The focal length that the poses have, beside that of EXIF.</p>\n"
          "<div class=\"scroll\"><table><tr><th>lens</th><th>photos</th><th>size, px</th><th>focal length, px</th>"
          "<th>by EXIF, px</th><th>difference</th><th class=\"words\">parameters</th></tr>\n",
          out);
    for (uint32_t i = 0; i < q->scene->n_cameras && rows < MOST_ROWS; i++) {
        const cn_camera *c = &q->scene->cameras[i];
        const cn_camera_quality *got = &q->cameras[i];
        if (!got->n_views) continue;
        rows++;
        fprintf(out, "<tr><td>%s</td><td>%u</td><td>%u x %u</td>", cn_lens_name(c->lens), got->n_views, c->width,
                c->height);
        cell(out, got->focal_px, 1);
        cell(out, got->exif_px, 1);
        if (isfinite(got->exif_px))
            fprintf(out, "<td>%+.1f %%</td>", 100.0 * (got->focal_px / got->exif_px - 1.0));
        else
            fputs("<td class=\"soft\">-</td>", out);
        fputs("<td class=\"words\">", out);
        for (int k = 0; k < cn_lens_params(c->lens); k++)
            fprintf(out, "%s%.5g", k ? ", " : "", c->params[k]);
        fputs("</td></tr>\n", out);
    }
    fputs("</table></div>\n", out);
}

static void write_groups(const cn_quality *q, FILE *out)
{
    static const char *const FATES[] = { "without a model", "joined", "apart: nothing ties it to the others" };
    const cn_merge_report *r = &q->grouped->report;
    fprintf(out,
            "<h2>Groups</h2>\n<p>%u of %u groups are joined; their photos were adjusted %s. <span class=\"soft\">Ties: "
            "how far apart a group and its neighbours put the points that they share, rms in metres, before that "
            "adjustment.</span></p>\n"
            "<div class=\"scroll\"><table><tr><th>group</th><th>photos</th><th>of them its own</th><th>posed</th>"
            "<th>neighbours</th><th>ties, m</th><th class=\"words\">what became of it</th></tr>\n",
            r->n_joined, r->n_groups, r->way == CN_MERGE_WHOLE ? "at once" : "group by group");
    for (uint32_t i = 0; i < r->n_groups && i < MOST_ROWS; i++) {
        const cn_group_row *row = &q->grouped->rows[i];
        const cn_group_report *g = &r->groups[i];
        fprintf(out, "<tr><td>%u</td><td>%u</td><td>%u</td><td>%u</td><td>%u</td>", i + 1, row->n, row->n_core,
                g->n_posed, g->n_links);
        cell(out, g->tie_rms_m, 3);
        fprintf(out, "<td class=\"words%s\">%s", g->fate == CN_GROUP_JOINED ? "" : " bad", FATES[g->fate]);
        if (row->why[0]) fputs(": ", out);
        put(out, row->why);
        fputs("</td></tr>\n", out);
    }
    fputs("</table></div>\n", out);
}

/* ---- photos, the worst first ---- */

typedef struct ranked {
    double error;
    uint32_t view;
} ranked;
static int by_error(const void *a, const void *b)
{
    const ranked *x = a, *y = b;
    if (x->error != y->error) return x->error < y->error ? 1 : -1;
    return (x->view > y->view) - (x->view < y->view);
}

static cn_status write_photos(const cn_quality *q, FILE *out)
{
    const uint32_t n = q->scene->n_views;
    ranked *order = malloc((n + (size_t)1) * sizeof *order);
    if (!order) return cn_fail(CN_ERR_NOMEM, "out of memory for the report");
    for (uint32_t i = 0; i < n; i++)
        order[i] = (ranked){ isfinite(q->views[i].off_m[0]) ? length(q->views[i].off_m) : -1.0, i };
    qsort(order, n, sizeof *order, by_error);
    fputs(
        "<h2>Photos</h2>\n<p class=\"soft\">Camera minus GPS in metres, the farthest first.</p>\n<div class=\"scroll\">"
        "<table><tr><th>photo</th><th>east</th><th>north</th><th>up</th><th>distance</th><th>stated by GPS</th>"
        "<th>sparse points</th><th>error, px</th></tr>\n",
        out);
    for (uint32_t r = 0; r < n && r < MOST_ROWS; r++) {
        const cn_view_quality *v = &q->views[order[r].view];
        fputs("<tr>", out);
        cell_text(out, q->scene->views[order[r].view].name);
        for (int k = 0; k < 3; k++)
            cell(out, v->off_m[k], 3);
        cell(out, order[r].error >= 0.0 ? order[r].error : NAN, 3);
        cell(out, v->sigma_m[0] > 0 ? length(v->sigma_m) : NAN, 3);
        fprintf(out, "<td>%u</td>", v->n_seen);
        cell(out, v->error_px, 2);
        fputs("</tr>\n", out);
    }
    fputs("</table></div>\n", out);
    if (n > MOST_ROWS) fprintf(out, "<p class=\"soft\">The first %d of %u; report.json has all.</p>\n", MOST_ROWS, n);
    free(order);
    return CN_OK;
}

/* A drawing keeps a size that can be read; on a narrow screen it scrolls. */
static cn_status draw(cn_status (*chart)(const cn_quality *q, FILE *out), const cn_quality *q, FILE *out)
{
    fputs("<div class=\"wide\">", out);
    CN_TRY(chart(q, out));
    fputs("</div>\n", out);
    return CN_OK;
}

static cn_status write_body(const cn_quality *q, FILE *out)
{
    fputs(HEAD, out);
    write_summary(q, out);
    fputs("<h2>Map</h2>\n", out);
    if (cn_report_drawn(q) < q->scene->n_views)
        fprintf(out, "<p class=\"soft\">The drawings show %u of the %u photos, evenly chosen.</p>\n",
                cn_report_drawn(q), q->scene->n_views);
    CN_TRY(draw(cn_report_draw_map, q, out));
    if (q->control && q->fit->n_points) write_control(q, out);
    if (q->grouped) write_groups(q, out);
    write_missing(q, out);
    if (isfinite(q->off_rms_m[0])) {
        fputs("<h2>GPS</h2>\n", out);
        CN_TRY(draw(cn_report_draw_gps, q, out));
    }
    if (q->scene->n_observations) {
        fputs("<h2>Reprojection errors</h2>\n", out);
        CN_TRY(draw(cn_report_draw_histogram, q, out));
        CN_TRY(draw(cn_report_draw_errors, q, out));
    }
    write_cameras(q, out);
    CN_TRY(write_photos(q, out));
    fputs("</body></html>\n", out);
    return CN_OK;
}

cn_status cn_quality_save_page(const cn_quality *q, const char *path)
{
    cn_writer writer = { 0 };
    CN_TRY(cn_writer_open(&writer, path));
    const locale_t before = cn_number_begin();
    cn_status status = write_body(q, writer.stream);
    cn_number_end(before);
    if (status == CN_OK) status = cn_writer_commit(&writer);
    cn_writer_abort(&writer);
    return status;
}
