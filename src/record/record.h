/* The records that say which artefacts are done and valid, and why others are not. */
#ifndef CONURB_RECORD_RECORD_H
#define CONURB_RECORD_RECORD_H
#include "city/workspace.h"
#include "conurb/train.h"

/* What an artefact depends on, by name, so that a person can be told which of it changed. The hash is of every value in
 * full. The text has a line "name=value" each, with room for more than a hundred; a long value stands there as its
 * beginning and its hash. */
typedef struct cn_fingerprint {
    uint64_t hash;
    size_t n;
    char text[16384];
} cn_fingerprint;
void cn_fingerprint_add(cn_fingerprint *fingerprint, const char *name, const char *format, ...) CN_PRINTF(3, 4);

enum { CN_STAGE_MADE = 5 };
/* A stage's identity: the settings and the parents' artefacts that mattered, and what it leaves. Names are relative to
 * the city. */
typedef struct cn_stage {
    char record[96];                 /* the record's file: written last, by cn_stage_finish */
    const char *made[CN_STAGE_MADE]; /* files whose content the record vouches for; NULL ends */
    char stamp[96]; /* or: a file, written after the others, that holds cn_stage_hash in its text; "" is none */
    cn_fingerprint config, parent;
} cn_stage;
/* Hash of both, for children. */
uint64_t cn_stage_hash(const cn_stage *stage);

enum { CN_REASON_SIZE = 200 };
/* True when the artefacts are there, are those that the record (or the stamp) speaks of, and were made of this very
 * identity. Otherwise reason (may be NULL) says in a few words what is missing or has changed. */
bool cn_stage_done(const cn_city *city, const cn_stage *stage, char reason[CN_REASON_SIZE]);
/* Whether the record is there and of this identity; for a stamped stage, that alone does not mean that it is done. */
bool cn_stage_recorded(const cn_city *city, const cn_stage *stage);
/* Writes the record. */
CN_NODISCARD cn_status cn_stage_finish(const cn_city *city, const cn_stage *stage);

/* ---- identity.c: the stages' identities, computed from city.yaml and the parents' artefacts ---- */
CN_NODISCARD cn_status cn_stage_poses(const cn_city *city, const cn_photo_index *index, cn_stage *stage);
/* CN_ERR_DATA when there are no poses. */
CN_NODISCARD cn_status cn_stage_plan(const cn_city *city, cn_stage *stage);
/* plan: from cn_stage_plan. */
void cn_stage_tile(const cn_city *city, const cn_stage *plan, const cn_train_options *options, const cn_plan_tile *tile,
                   const cn_scene *scene, cn_stage *stage);
/* Adds every trained tile to the parents. */
CN_NODISCARD cn_status cn_stage_add_tiles(const cn_city *city, const cn_plan *plan, cn_stage *stage);
/* Of the held-out photos' scores: depends on every trained tile. */
CN_NODISCARD cn_status cn_stage_eval(const cn_city *city, const cn_plan *plan, cn_stage *stage);
#endif
