/* An open city, and the records that say which artefacts are done and valid. */
#ifndef CONURB_JOB_WORKSPACE_H
#define CONURB_JOB_WORKSPACE_H
#include "job/config.h"

struct cn_city { char *folder; cn_config config; };

/* Joins the city's folder with a relative name; caller frees; NULL when out of memory. */
char *cn_city_path(const cn_city *city, const char *name);

/* A stage's record: FOLDER/NAME.stage.json with the hash of the configuration that mattered and of what it was made from. */
typedef struct cn_stage { const char *record; uint64_t config, parent; } cn_stage; /* record: relative to the city */
/* True when the record is there with the same hashes, and `artefact` (relative; may be NULL) exists. */
bool cn_stage_done(const cn_city *city, const cn_stage *stage, const char *artefact);
CN_NODISCARD cn_status cn_stage_finish(const cn_city *city, const cn_stage *stage);
/* Hash of both, for children. */
uint64_t cn_stage_hash(const cn_stage *stage);
/* Adds printf text to a hash. */
uint64_t cn_hash_text(uint64_t hash, const char *format, ...) CN_PRINTF(2, 3);

/* The stages' identities, computed from city.yaml and the parents' artefacts. */
CN_NODISCARD cn_status cn_stage_poses(const cn_city *city, const cn_photo_index *index, cn_stage *stage);
CN_NODISCARD cn_status cn_stage_plan(const cn_city *city, cn_stage *stage);
CN_NODISCARD cn_status cn_stage_tile(const cn_city *city, const cn_train_options *options, const cn_plan_tile *tile, const cn_scene *scene, char *record,
                                     size_t size, cn_stage *stage);

/* What most stages need: photos, poses, frame, pixels, plan. Zeroed where it was not asked for. */
typedef struct cn_material {
    cn_photo_index photos; cn_scene scene; cn_frame frame; cn_pixel_store *pixels; cn_plan plan;
} cn_material;
/* CN_ERR_DATA names the command to run first. with_plan: pixels and plan too. */
CN_NODISCARD cn_status cn_material_load(const cn_context *ctx, const cn_city *city, bool with_plan, cn_material *material);
void cn_material_deinit(cn_material *material);
#endif
