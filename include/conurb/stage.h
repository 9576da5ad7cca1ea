/* conurb/stage.h: the stages of a city, one function a command. The conurb program is a thin caller of these. */
#ifndef CONURB_STAGE_H
#define CONURB_STAGE_H
#include "conurb/base.h"
#include "conurb/city.h"
#include "conurb/compose.h"
#include "conurb/measure.h"
#include "conurb/path.h"
#include "conurb/plan.h"
#include "conurb/pose.h"
#include "conurb/render.h"
#include "conurb/train.h"
#ifdef __cplusplus
extern "C" {
#endif

/* Stages. Each skips work that is done and valid (config hash and parent hash) and makes its parents' artefacts a
 * precondition: CN_ERR_DATA names the command to run first. */
CN_API CN_NODISCARD cn_status cn_city_poses(const cn_context *ctx, cn_city *city);
/* dry_run: logged, not written. forecast: ends with what training the tiles would take on this machine, for each
 * preset, as cn_train_speed_predict says; what is measured is kept in the user's cache
 * ($XDG_CACHE_HOME/conurb/speed.json). */
CN_API CN_NODISCARD cn_status cn_city_plan(const cn_context *ctx, cn_city *city, bool dry_run, bool forecast);
/* tile NULL: all; one that fails does not stop the others, and the message at the end names each with its reason and
 * its log. CN_ERR_LOCKED while another process has the tile. quality < 0: from city.yaml. time_budget_s, of a tile; 0:
 * from city.yaml. With a budget and no quality or size of the field named, here or there, these are chosen for it
 * (cn_train_choose). */
CN_API CN_NODISCARD cn_status cn_city_train(const cn_context *ctx, cn_city *city, const char *tile, int quality,
                                            double time_budget_s);
/* One light in all trained tiles (cn_appearance_align): the rows of `appearance` (as in cn_city_render_options) in
 * CITY/match, made unless they are there and of these tiles. Logs the difference of each two neighbours. A render does
 * the same for its lights. */
CN_API CN_NODISCARD cn_status cn_city_align(const cn_context *ctx, cn_city *city, const char *appearance);
typedef struct cn_city_render_options {
    const char *path;        /* a file that cn_path_load reads, "photos" for the photos' own order, or NULL */
    const char *orbit;       /* as cn_path_orbit takes it, or NULL */
    const char *photo;       /* a photo's own view, or NULL; all three NULL: the default flight */
    double height_m;         /* above the ground, for streets and tracks on it; 0: as the file says */
    const char *out;         /* folder; NULL: CITY/renders/NAME */
    const char *appearance;  /* PHOTO | mean | A:B:0.3 | FILE.json | fit:PHOTO; NULL: mean */
    const char *sequence;    /* instead: "A,B,C", one light after another along the frames */
    const char *view, *look; /* NULL: defaults */
    double exposure_ev;
    const char *blend;           /* a name of cn_blend_parse; NULL: from city.yaml */
    uint32_t width_px, n_frames; /* 0: from city.yaml */
    uint32_t chunk, n_chunks;    /* only the frames of part chunk (from 1) of n_chunks; n_chunks 0: all */
} cn_city_render_options;
/* CN_ERR_LOCKED while another process makes the same frames. Frames that are done (same tiles, view and light) are
 * kept. */
CN_API CN_NODISCARD cn_status cn_city_render(const cn_context *ctx, cn_city *city,
                                             const cn_city_render_options *options);
/* Which frames of such a render are done and valid; renders nothing. CN_ERR_DATA when no tile is trained. */
typedef struct cn_render_survey {
    uint32_t n_frames, n_done;
    bool *done;
} cn_render_survey;
CN_API CN_NODISCARD cn_status cn_city_render_survey(const cn_context *ctx, cn_city *city,
                                                    const cn_city_render_options *options, cn_render_survey *survey);
CN_API void cn_render_survey_deinit(cn_render_survey *survey);
/* Renders the path of such a render frame by frame, keeps none of them, and says whether it is steady where tiles meet
 * (cn_measure_temporal) and, by ownership, whether a frame has seams (cn_measure_seam; n is 0 by the other schemes,
 * whose shares do not end within a frame). Looks at path, orbit, photo, height_m, appearance, blend, width_px,
 * n_frames. */
CN_API CN_NODISCARD cn_status cn_city_temporal_consistency(const cn_context *ctx, cn_city *city,
                                                           const cn_city_render_options *options,
                                                           cn_temporal_figures *figures, cn_seam_figures *seam);
/* ---- appearances; CODE as in cn_city_render_options ---- */
/* A photo whose light can be asked for. exposure_ev is NaN where EXIF does not say. */
typedef struct cn_appearance_entry {
    char *name;
    double exposure_ev;
    uint32_t n_tiles;
    bool held_out;
} cn_appearance_entry;
typedef struct cn_appearance_list {
    cn_appearance_entry *entries;
    uint32_t n;
} cn_appearance_list;
CN_API CN_NODISCARD cn_status cn_city_appearance_list(const cn_context *ctx, cn_city *city, cn_appearance_list *list);
CN_API void cn_appearance_list_deinit(cn_appearance_list *list);
/* The rows of a code in every trained tile, as JSON; caller frees. */
CN_API CN_NODISCARD cn_status cn_city_appearance_show(const cn_context *ctx, cn_city *city, const char *code,
                                                      char **json);
CN_API CN_NODISCARD cn_status cn_city_appearance_export(const cn_context *ctx, cn_city *city, const char *code,
                                                        const char *file);
/* Checks FILE against the city's tiles and keeps it as CITY/appearances/NAME.json; NAME is then a code. */
CN_API CN_NODISCARD cn_status cn_city_appearance_import(const cn_context *ctx, cn_city *city, const char *file,
                                                        const char *name);
/* PNG: one view (a photo's; NULL: the first's) under the mean and the light of every photo trained on, at most 100. */
CN_API CN_NODISCARD cn_status cn_city_appearance_sheet(const cn_context *ctx, cn_city *city, const char *photo,
                                                       uint32_t width_px, const char *file);
/* PNG: a photo, what training took for standing in it only, and the alpha of that, side by side. */
CN_API CN_NODISCARD cn_status cn_city_appearance_transient(const cn_context *ctx, cn_city *city, const char *photo,
                                                           const char *file);

/* Held-out photos, each rendered by the tiles in reach and composed. Writes CITY/eval/{eval.json,NAME.png} (truth,
 * render, error side by side). blend: a name of cn_blend_parse, for a comparison, which goes into CITY/eval-NAME; NULL:
 * from city.yaml. */
CN_API CN_NODISCARD cn_status cn_city_eval(const cn_context *ctx, cn_city *city, const char *blend, cn_eval *eval);
typedef struct cn_city_export_options {
    const char *ortho, *dsm, *points; /* files; all NULL: CITY/export/{ortho.tif,dsm.tif,points.ply} */
    double gsd_m;            /* metres a pixel, and between points; 0: as fine as the photos at their working width */
    const char *appearance;  /* as in cn_city_render_options */
    const char *view, *look; /* NULL: from city.yaml */
    double exposure_ev;
} cn_city_export_options;
/* Orthophoto, surface model and points from all trained tiles together (conurb/export.h). */
CN_API CN_NODISCARD cn_status cn_city_export(const cn_context *ctx, cn_city *city,
                                             const cn_city_export_options *options);
/* ---- what accuracy costs ---- */
typedef struct cn_tradeoff_options {
    bool effects;     /* each effect turned, instead of each setting */
    const char *tile; /* NULL: the one with the most photos */
    int quality;      /* < 0: from city.yaml */
    uint32_t steps;   /* 0: as the quality has them */
    double budget_s;  /* 0: as long as it takes */
    bool fields;      /* each type of field at two sizes, instead of each setting */
} cn_tradeoff_options;
/* Trains one tile at several settings below CITY/tradeoff/ and measures each on the tile's held-out photos; what an
 * earlier call measured is kept. Writes CITY/tradeoff.{csv,svg}, or CITY/tradeoff-effects.{csv,svg}, or
 * CITY/tradeoff-fields.{csv,svg}, with rows TYPE and TYPE-small. With effects row 0
 * is the plan's choice, and the others are named with-NAME or without-NAME. Caller frees. CN_ERR_DATA when nothing is
 * held out. */
CN_API CN_NODISCARD cn_status cn_city_tradeoff(const cn_context *ctx, cn_city *city, const cn_tradeoff_options *options,
                                               cn_tradeoff *tradeoff);

/* All of the above in order, skipping what is done; ends with the default flight rendered. When tiles fail, the rest is
 * made without them, and their failure is returned at the end. Quality and budget as in cn_city_train. */
CN_API CN_NODISCARD cn_status cn_city_run(const cn_context *ctx, cn_city *city, int quality, double time_budget_s);

#ifdef __cplusplus
}
#endif
#endif
