#include "conurb/batch.h"

#include "base/file.h"
#include "batch/groups.h"
#include "renderer/alignment.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

enum { FIT_S = 10 }; /* seconds on one processor to fit a tile's row to its neighbours, or to a photo */

typedef struct grower {
    const cn_context *ctx;
    cn_city *city;
    cn_train_options train;
    cn_job_graph *graph;
    char due[CN_TILE_ID_SIZE]; /* id of a tile that is not done; "" when all are done */
    bool match_due;
} grower;

static cn_status add(grower *g, const char *stage, const char *item, bool done, const char *reason, cn_job_node **out)
{
    cn_job_graph *graph = g->graph;
    cn_job_node *larger = realloc(graph->nodes, (graph->n + 1) * sizeof *larger);
    if (!larger) return cn_fail(CN_ERR_NOMEM, "out of memory for the list of what is due");
    graph->nodes = larger;
    cn_job_node *node = &larger[graph->n++];
    *node = (cn_job_node){ .done = done };
    snprintf(node->stage, sizeof node->stage, "%s", stage);
    snprintf(node->item, sizeof node->item, "%s", item);
    if (!done) snprintf(node->reason, sizeof node->reason, "%s", reason);
    graph->n_due += !done;
    if (out) *out = node;
    return CN_OK;
}

static bool is_there(const char *file)
{
    return !file || cn_file_exists(file);
}

/* The photos as the poses know them. there: false, with the reason, where no file tells them. */
static cn_status load_photos(const cn_city *city, cn_photo_index *index, bool *there, char *reason)
{
    char *path = cn_city_path(city, "photos.json");
    if (!path) return cn_fail(CN_ERR_NOMEM, "out of memory for the list of what is due");
    snprintf(reason, CN_REASON_SIZE, "not made yet");
    *there = cn_file_exists(path);
    if (*there && cn_photo_index_load(index, path) != CN_OK) {
        snprintf(reason, CN_REASON_SIZE, "%s", cn_error_message());
        *there = false;
    }
    free(path);
    return CN_OK;
}

static cn_status look_at_poses(grower *g, bool quick, bool *done, char *reason)
{
    cn_photo_index index;
    cn_stage stage;
    if (quick) {
        bool there = false;
        CN_TRY(load_photos(g->city, &index, &there, reason));
        *done = false;
        if (!there) return CN_OK;
        /* A worker of a cluster need not have what the poses were made from. */
        *done = !is_there(g->city->config.import) || !is_there(g->city->config.control);
        if (*done) {
            cn_photo_index_deinit(&index);
            return CN_OK;
        }
    } else {
        CN_TRY(cn_photo_index_scan(g->ctx, g->city->config.photos, &index));
    }
    const cn_status status = cn_stage_poses(g->city, &index, &stage);
    if (status == CN_OK) *done = cn_stage_done(g->city, &stage, reason);
    cn_photo_index_deinit(&index);
    return status;
}

/* What a group takes: COLMAP's features (2 s and a thread's working memory a photo), matches of each photo with its
 * neighbours, and mapping. */
static void group_cost(const grower *g, uint32_t n_photos, cn_job_node *node)
{
    const double pairs = 0.5 * n_photos * g->city->config.poses.neighbours;
    node->estimate_s = 4.0 * n_photos + 0.2 * pairs;
    node->estimate_bytes = (uint64_t)3 << 30;
    node->estimate_bytes += (uint64_t)n_photos * 4000000;
}

/* The groups of photos, where the city has any. poses_done: nothing is due, whatever their files say. */
static cn_status look_at_groups(grower *g, bool poses_done, uint32_t *n_due)
{
    cn_group_rows rows;
    CN_TRY(cn_group_rows_read(g->city, &rows));
    cn_status status = CN_OK;
    for (uint32_t i = 0; i < rows.n && status == CN_OK; i++) {
        const cn_group_item *row = &rows.items[i];
        char item[16], reason[CN_REASON_SIZE];
        cn_job_node *node;
        const bool done = poses_done || row->done || row->hopeless;
        snprintf(item, sizeof item, "%u", i + 1);
        if (row->why[0])
            snprintf(reason, sizeof reason, "failed: %.180s", row->why);
        else
            snprintf(reason, sizeof reason, "not mapped yet");
        status = add(g, "group", item, done, reason, &node);
        if (status != CN_OK) break;
        node->failed = row->why[0] != '\0';
        group_cost(g, row->n_photos, node);
        *n_due += !done;
    }
    cn_group_rows_deinit(&rows);
    return status;
}

/* Seconds of n pictures: a pixel of one tile takes about 50 microseconds on one processor; a picture is at most about
 * as high as wide. */
static double pictures_s(const grower *g, uint32_t width_px, double n)
{
    return 50e-6 * width_px * width_px * g->city->config.compose.max_tiles * n;
}

/* The open tiles, and what is kept of a picture's pixel. */
static uint64_t pictures_bytes(const grower *g, uint32_t width_px, uint64_t pixel)
{
    const uint64_t tile = cn_field_options_bytes(&g->train.field);
    return tile * (g->city->config.compose.max_tiles + 1) + pixel * width_px * width_px;
}

static cn_status add_frames(grower *g, uint32_t n, const bool *done, const char *reason)
{
    const uint32_t chunks = (n + CN_CHUNK_FRAMES - 1) / CN_CHUNK_FRAMES;
    const uint32_t width_px = g->city->config.render_width_px;
    for (uint32_t i = 0; i < chunks; i++) {
        const uint32_t first = (uint32_t)((uint64_t)n * i / chunks), last = (uint32_t)((uint64_t)n * (i + 1) / chunks);
        uint32_t n_done = 0;
        char item[48], missing[CN_REASON_SIZE];
        for (uint32_t f = first; done && f < last; f++)
            n_done += done[f];
        snprintf(item, sizeof item, "%u/%u", i + 1, chunks);
        if (reason)
            snprintf(missing, sizeof missing, "%s", reason);
        else
            snprintf(missing, sizeof missing, "%u of %u frames not made yet, or of other tiles", last - first - n_done,
                     last - first);
        cn_job_node *node;
        CN_TRY(add(g, "render", item, n_done == last - first, missing, &node));
        node->estimate_s = pictures_s(g, width_px, last - first - n_done);
        node->estimate_bytes = pictures_bytes(g, width_px, 64);
    }
    return CN_OK;
}

static cn_status look_at_frames(grower *g)
{
    char reason[CN_REASON_SIZE];
    if (g->due[0]) {
        snprintf(reason, sizeof reason, "tile %s comes first", g->due);
        return add_frames(g, g->city->config.render_frames, NULL, reason);
    }
    if (g->match_due) return add_frames(g, g->city->config.render_frames, NULL, "the match comes first");
    cn_render_survey survey;
    const cn_city_render_options flight = { 0 };
    CN_TRY(cn_city_render_survey(g->ctx, g->city, &flight, &survey));
    const cn_status status = add_frames(g, survey.n_frames, survey.done, NULL);
    cn_render_survey_deinit(&survey);
    return status;
}

/* With a time budget the machine that trains chooses the settings, so reserve memory for any of them. */
static void node_cost(const grower *g, const cn_plan_tile *tile, cn_job_node *node)
{
    cn_train_cost(&g->train, tile, &node->estimate_s, &node->estimate_bytes);
    for (int q = CN_QUALITY_PREVIEW; g->train.choose && q <= CN_QUALITY_REFERENCE; q++) {
        const cn_train_options o = cn_train_options_within(&g->train, (cn_quality)q);
        const uint64_t most = g->city->config.plan.max_tile_bytes;
        double seconds;
        uint64_t bytes;
        cn_train_cost(&o, tile, &seconds, &bytes);
        if (bytes > node->estimate_bytes && (!most || bytes <= most)) node->estimate_bytes = bytes;
    }
}

static cn_status look_at_tiles(grower *g, const cn_dataset *m, const char *plan_due)
{
    cn_stage plan, stage;
    const long processors = sysconf(_SC_NPROCESSORS_ONLN);
    CN_TRY(cn_stage_plan(g->city, &plan));
    for (uint32_t i = 0; i < m->plan.n_tiles; i++) {
        const cn_plan_tile *tile = &m->plan.tiles[i];
        char reason[CN_REASON_SIZE] = "the plan comes first";
        cn_job_node *node;
        cn_stage_tile(g->city, &plan, &g->train, tile, &m->scene, &stage);
        const bool done = !plan_due && cn_stage_done(g->city, &stage, reason);
        if (!done && !g->due[0]) snprintf(g->due, sizeof g->due, "%s", tile->id);
        CN_TRY(add(g, "train", tile->id, done, reason, &node));
        node_cost(g, tile, node);
        node->budgeted = g->train.time_budget_s > 0;
        node->estimate_s *= node->budgeted || processors < 1 ? 1 : (double)processors;
    }
    return CN_OK;
}

/* The alignment of the default flight's appearance. */
static cn_status look_at_match(grower *g, const cn_plan *plan)
{
    if (plan->n_tiles < 2 || !g->city->config.match) return CN_OK;
    const cn_appearance_spec mean = { .kind = CN_APPEARANCE_MEAN };
    cn_stage stage;
    char reason[CN_REASON_SIZE];
    cn_job_node *node;
    CN_TRY(cn_stage_alignment(g->city, plan, &mean, &stage));
    snprintf(reason, sizeof reason, "tile %s comes first", g->due);
    g->match_due = g->due[0] || !cn_stage_done(g->city, &stage, reason);
    CN_TRY(add(g, "match", "", !g->match_due, reason, &node));
    node->estimate_s = FIT_S * plan->n_tiles;
    node->estimate_bytes = pictures_bytes(g, 0, 0);
    return CN_OK;
}

/* Photos that a tile of the plan holds out. */
static cn_status count_held_out(const cn_dataset *m, uint32_t *n)
{
    bool *held = calloc(m->scene.n_views + (size_t)1, sizeof *held);
    if (!held) return cn_fail(CN_ERR_NOMEM, "out of memory for the list of what is due");
    for (uint32_t i = 0; i < m->plan.n_tiles; i++)
        for (uint32_t k = 0; k < m->plan.tiles[i].n_held_out; k++) {
            bool *of = &held[m->plan.tiles[i].held_out[k]];
            *n += !*of;
            *of = true;
        }
    free(held);
    return CN_OK;
}

/* A photo is rendered in its known light and in a fitted one, and each tile of it is fitted. */
static cn_status look_at_eval(grower *g, const cn_dataset *m)
{
    uint32_t held_out = 0;
    CN_TRY(count_held_out(m, &held_out));
    if (!held_out) return CN_OK;
    const cn_config *c = &g->city->config;
    cn_stage stage;
    char reason[CN_REASON_SIZE];
    cn_job_node *node;
    CN_TRY(cn_stage_eval(g->city, &m->plan, &stage));
    snprintf(reason, sizeof reason, "tile %s comes first", g->due);
    const bool done = !g->due[0] && cn_stage_done(g->city, &stage, reason);
    CN_TRY(add(g, "eval", "", done, reason, &node));
    node->estimate_s = pictures_s(g, c->width_px, 2.0 * held_out) + (double)FIT_S * c->compose.max_tiles * held_out;
    node->estimate_bytes = pictures_bytes(g, c->width_px, 128); /* photo, render and both side by side, in floats */
    return CN_OK;
}

/* Adds the jobs after the plan, when the plan can be read, valid or not. */
static cn_status look_past_plan(grower *g, const char *plan_due)
{
    cn_dataset m;
    CN_TRY(cn_dataset_load(NULL, g->city, false, &m));
    char *dir = cn_city_path(g->city, "plan");
    cn_status status = dir ? cn_plan_load(&m.plan, &m.scene, dir) : cn_fail(CN_ERR_NOMEM, "out of memory");
    free(dir);
    if (status == CN_OK) status = look_at_tiles(g, &m, plan_due);
    if (status == CN_OK) status = look_at_match(g, &m.plan);
    if (status == CN_OK) status = look_at_eval(g, &m);
    if (status == CN_OK) status = look_at_frames(g);
    cn_dataset_deinit(&m);
    return status;
}

static cn_status grow(grower *g, bool quick)
{
    char reason[CN_REASON_SIZE] = "";
    bool done = false;
    uint32_t n_due = 0;
    CN_TRY(look_at_poses(g, quick, &done, reason));
    CN_TRY(look_at_groups(g, done, &n_due));
    if (n_due && !done) snprintf(reason, sizeof reason, "%u groups come first", n_due);
    CN_TRY(add(g, "poses", "", done, reason, NULL));
    cn_stage plan;
    char *path = cn_city_path(g->city, "plan/plan.json");
    const bool readable = done && path && cn_file_exists(path);
    free(path);
    if (!done) {
        snprintf(reason, sizeof reason, "the poses come first");
    } else {
        CN_TRY(cn_stage_plan(g->city, &plan));
        done = cn_stage_done(g->city, &plan, reason);
    }
    CN_TRY(add(g, "plan", "", done, reason, NULL));
    if (readable) return look_past_plan(g, done ? NULL : reason);
    CN_TRY(add(g, "train", "every tile", false, "the plan comes first", NULL));
    return add_frames(g, g->city->config.render_frames, NULL, "the plan comes first");
}

cn_status cn_city_graph(const cn_context *ctx, cn_city *city, int quality, double time_budget_s, bool quick,
                        cn_job_graph *graph)
{
    *graph = (cn_job_graph){ 0 };
    grower g = {
        .ctx = ctx, .city = city, .train = cn_config_train(&city->config, quality, time_budget_s), .graph = graph
    };
    const cn_status status = grow(&g, quick);
    if (status != CN_OK) cn_job_graph_deinit(graph);
    return status;
}

void cn_job_graph_deinit(cn_job_graph *graph)
{
    free(graph->nodes);
    *graph = (cn_job_graph){ 0 };
}
