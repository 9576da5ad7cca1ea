/* conurb/job.h: a city's workspace and its stages. One function a command; the binary is a thin caller of these. */
#ifndef CONURB_JOB_H
#define CONURB_JOB_H
#include "conurb/base.h"
#include "conurb/compose.h"
#include "conurb/measure.h"
#include "conurb/plan.h"
#include "conurb/pose.h"
#include "conurb/render.h"
#include "conurb/train.h"
#ifdef __cplusplus
extern "C" {
#endif

/* A workspace that is open: its folder, its parsed city.yaml. */
typedef struct cn_city cn_city;

typedef struct cn_init_options {
    const char *photos;  /* folder; required */
    const char *import;  /* COLMAP model, transforms.json or NULL */
    uint32_t width_px;   /* 0: 800 */
} cn_init_options;
/* Makes CITY with a commented city.yaml. CN_ERR_USAGE when CITY already is a workspace; CN_ERR_DATA when there are no photos. */
CN_API CN_NODISCARD cn_status cn_city_init(const cn_context *ctx, const char *city, const cn_init_options *options);
/* Opens CITY; CN_ERR_CONFIG with file:line for unknown keys and wrong types; CN_ERR_VERSION for a newer workspace. */
CN_API CN_NODISCARD cn_status cn_city_open(cn_city **city, const char *folder);
CN_API void cn_city_close(cn_city **city);
CN_API const char *cn_city_folder(const cn_city *city);

/* Stages. Each skips work that is done and valid (config hash and parent hash) and makes its parents' artefacts a precondition:
 * CN_ERR_DATA names the command to run first. */
CN_API CN_NODISCARD cn_status cn_city_poses(const cn_context *ctx, cn_city *city);
CN_API CN_NODISCARD cn_status cn_city_plan(const cn_context *ctx, cn_city *city, bool dry_run);
/* tile NULL: all. quality < 0: from city.yaml. time_budget_s 0: from city.yaml. */
CN_API CN_NODISCARD cn_status cn_city_train(const cn_context *ctx, cn_city *city, const char *tile, int quality, double time_budget_s);
typedef struct cn_city_render_options {
    const char *path;    /* a file that cn_path_load reads, "photos" for the photos' own order, or NULL */
    const char *orbit;   /* as cn_path_orbit takes it, or NULL */
    const char *photo;   /* a photo's own view, or NULL; all three NULL: the default flight */
    double height_m;     /* above the ground, for streets and tracks on it; 0: as the file says */
    const char *out;     /* folder; NULL: CITY/renders/NAME */
    const char *appearance, *view, *look; /* NULL: defaults */
    double exposure_ev;
    uint32_t width_px, n_frames; /* 0: from city.yaml */
} cn_city_render_options;
CN_API CN_NODISCARD cn_status cn_city_render(const cn_context *ctx, cn_city *city, const cn_city_render_options *options);
/* Held-out photos, each rendered by the tiles in reach and composed. Writes CITY/eval/{eval.json,NAME.png} (truth, render, error side by side). */
CN_API CN_NODISCARD cn_status cn_city_eval(const cn_context *ctx, cn_city *city, cn_eval *eval);
/* All of the above in order, skipping what is done; ends with the default flight rendered. */
CN_API CN_NODISCARD cn_status cn_city_run(const cn_context *ctx, cn_city *city, int quality);

#ifdef __cplusplus
}
#endif
#endif
