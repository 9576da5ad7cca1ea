/* poses/report.json */
#include "base/file.h"
#include "base/json.h"
#include "pose/lens.h"
#include "pose/quality.h"

#include <math.h>

enum { VERSION = 1 };

static json_t *text(const char *utf8)
{
    json_t *value = json_string(utf8);
    return value ? value : json_string("(a name that is not UTF-8)");
}

static json_t *photos(const cn_quality *q)
{
    json_t *list = json_array();
    for (uint32_t i = 0; i < q->scene->n_views; i++) {
        const cn_view_quality *v = &q->views[i];
        json_t *o = json_pack("{s:o, s:o, s:i, s:o, s:o, s:b}", "name", text(q->scene->views[i].name), "centre_m",
                              cn_json_reals(v->centre, 3), "sparse_points", (int)v->n_seen, "error_px",
                              cn_json_real(v->error_px), "centre_minus_gps_m", cn_json_reals(v->off_m, 3),
                              "agrees_with_gps", (int)v->agrees);
        if (v->sigma_m[0] > 0) json_object_set_new(o, "gps_sigma_m", cn_json_reals(v->sigma_m, 3));
        json_array_append_new(list, o);
    }
    return list;
}

static json_t *missing(const cn_quality *q)
{
    json_t *list = json_array();
    for (uint32_t i = 0; i < q->n_missing; i++) {
        const cn_missing_photo *m = &q->missing[i];
        json_array_append_new(list,
                              json_pack("{s:o, s:o, s:i, s:i, s:o}", "name", text(q->index->photos[m->photo].name),
                                        "why", text(m->why), "features", (int)m->n_features, "best_matches",
                                        (int)m->n_verified, "sharpness", cn_json_real(m->sharpness)));
    }
    return list;
}

static json_t *cameras(const cn_quality *q)
{
    json_t *list = json_array();
    for (uint32_t i = 0; i < q->scene->n_cameras; i++) {
        const cn_camera *c = &q->scene->cameras[i];
        if (!q->cameras[i].n_views) continue;
        json_array_append_new(list,
                              json_pack("{s:s, s:i, s:i, s:o, s:i, s:o, s:o}", "lens", cn_lens_name(c->lens), "width",
                                        (int)c->width, "height", (int)c->height, "params",
                                        cn_json_reals(c->params, (size_t)cn_lens_params(c->lens)), "photos",
                                        (int)q->cameras[i].n_views, "focal_px", cn_json_real(q->cameras[i].focal_px),
                                        "exif_focal_px", cn_json_real(q->cameras[i].exif_px)));
    }
    return list;
}

static json_t *control(const cn_quality *q)
{
    json_t *list = json_array();
    for (uint32_t i = 0; i < q->fit->n_points; i++) {
        const cn_control_residual *r = &q->fit->points[i];
        json_array_append_new(list,
                              json_pack("{s:o, s:b, s:i, s:o, s:o, s:o}", "name", text(q->control->points[i].name),
                                        "check", (int)q->control->points[i].check, "photos", (int)r->n_views,
                                        "residual_m", cn_json_reals(r->residual_m, 3), "by_gps_alone_m",
                                        cn_json_reals(r->before_m, 3), "error_px", cn_json_real(r->error_px)));
    }
    return json_pack("{s:o, s:o, s:o, s:o, s:b}", "points", list, "control_rms_m",
                     cn_json_reals(q->fit->control_rms_m, 3), "check_rms_m", cn_json_reals(q->fit->check_rms_m, 3),
                     "check_rms_by_gps_alone_m", cn_json_reals(q->fit->check_before_m, 3), "adjusted",
                     (int)q->fit->adjusted);
}

static json_t *groups(const cn_quality *q)
{
    static const char *const FATES[] = { "without a model", "joined", "apart" };
    const cn_merge_report *r = &q->grouped->report;
    json_t *list = json_array();
    for (uint32_t i = 0; i < r->n_groups; i++) {
        const cn_group_row *row = &q->grouped->rows[i];
        const cn_group_report *g = &r->groups[i];
        json_array_append_new(list,
                              json_pack("{s:i, s:i, s:i, s:i, s:s, s:i, s:o, s:o, s:o}", "group", (int)i + 1, "photos",
                                        (int)row->n, "core", (int)row->n_core, "posed", (int)g->n_posed, "fate",
                                        FATES[g->fate], "neighbours", (int)g->n_links, "tie_rms_m",
                                        cn_json_real(g->tie_rms_m), "way", text(row->way), "why", text(row->why)));
    }
    return list;
}

static json_t *histogram(const cn_quality *q)
{
    json_t *list = json_array();
    for (int i = 0; i < CN_QUALITY_BINS; i++)
        json_array_append_new(list, json_integer((json_int_t)q->histogram[i]));
    return json_pack("{s:o, s:o}", "bin_px", cn_json_real(CN_QUALITY_MOST_PX / CN_QUALITY_BINS), "counts", list);
}

cn_status cn_quality_save_json(const cn_quality *q, const char *path)
{
    json_t *root = json_pack("{s:i, s:o, s:i, s:i, s:o, s:i, s:o, s:o, s:o, s:o, s:o}", "version", VERSION, "source",
                             text(q->source), "registered", (int)q->scene->n_views, "models", (int)q->n_models,
                             "mean_error_px", cn_json_real(q->mean_error_px), "sparse_points", (int)q->scene->n_points,
                             "gps_rms_m", cn_json_reals(q->off_rms_m, 3), "photos", photos(q), "unregistered",
                             missing(q), "cameras", cameras(q), "errors", histogram(q));
    if (root && q->way) {
        json_object_set_new(root, "attempt", json_integer(q->attempt));
        json_object_set_new(root, "attempt_way", text(q->way));
    }
    if (root && q->grouped) {
        json_object_set_new(root, "groups", groups(q));
        json_object_set_new(root, "adjusted",
                            text(q->grouped->report.way == CN_MERGE_WHOLE ? "at once" : "group by group"));
    }
    if (root && q->import)
        json_object_set_new(root, "import",
                            json_pack("{s:o, s:s, s:i, s:i, s:i}", "file", text(q->import), "outcome",
                                      cn_quality_outcome(q), "with_gps", (int)q->verdict.n_gps, "agree",
                                      (int)q->verdict.n_agree, "agree_found_anew", (int)q->verdict.n_agree_anew));
    if (root && q->control) json_object_set_new(root, "control", control(q));
    const cn_status status = root ? cn_json_save(root, path) : cn_fail(CN_ERR_NOMEM, "%s: out of memory", path);
    json_decref(root);
    return status;
}
