/* The records that say which artefacts are done and valid, and why others are not. */
#ifndef CONURB_RECORD_RECORD_H
#define CONURB_RECORD_RECORD_H
#include "city/workspace.h"
#include "conurb/train.h"

/* The values that an artefact depends on, with names, so that a message can say which one changed. The hash covers
 * every value in full. The text has one line "name=value" for each, and room for more than a hundred; a long value is
 * shortened to its beginning and its hash. */
typedef struct cn_fingerprint {
    uint64_t hash;
    size_t n;
    char text[16384];
} cn_fingerprint;
void cn_fingerprint_add(cn_fingerprint *fingerprint, const char *name, const char *format, ...) CN_PRINTF(3, 4);

enum { CN_STAGE_MADE = 5 };
/* A stage's identity: the settings and input artefacts that it depends on, and the files that it writes. Names are
 * relative to the city. */
typedef struct cn_stage {
    char record[96];                 /* file of the record; cn_stage_finish writes it last */
    const char *made[CN_STAGE_MADE]; /* files whose content is hashed in the record; NULL ends the list */
    char stamp[96]; /* or: a file, written after the others, whose text contains cn_stage_hash; "": none */
    cn_fingerprint config, parent;
} cn_stage;
/* The hash of the identity, for later stages. */
uint64_t cn_stage_hash(const cn_stage *stage);

enum { CN_REASON_SIZE = 200 };
/* True when the artefacts exist, match the record (or the stamp), and were made with this identity. Otherwise reason
 * (may be NULL) says in a few words what is missing or has changed. */
bool cn_stage_done(const cn_city *city, const cn_stage *stage, char reason[CN_REASON_SIZE]);
/* Whether the record exists and has this identity. A stamped stage may still not be done. */
bool cn_stage_recorded(const cn_city *city, const cn_stage *stage);
/* Writes the record. */
CN_NODISCARD cn_status cn_stage_finish(const cn_city *city, const cn_stage *stage);

/* ---- identity.c: the stages' identities, computed from city.yaml and the parents' artefacts ---- */
CN_NODISCARD cn_status cn_stage_poses(const cn_city *city, const cn_photo_index *index, cn_stage *stage);
/* What the groups of a city's photos depend on, as a hash in hex. */
void cn_stage_groups_key(const cn_city *city, const cn_photo_index *index, char key[17]);
/* CN_ERR_DATA: there are no poses. */
CN_NODISCARD cn_status cn_stage_plan(const cn_city *city, cn_stage *stage);
/* plan: from cn_stage_plan. */
void cn_stage_tile(const cn_city *city, const cn_stage *plan, const cn_train_options *options, const cn_plan_tile *tile,
                   const cn_scene *scene, cn_stage *stage);
/* Adds every trained tile to the inputs. */
CN_NODISCARD cn_status cn_stage_add_tiles(const cn_city *city, const cn_plan *plan, cn_stage *stage);
/* The identity of the scores of held-out photos; depends on every trained tile. */
CN_NODISCARD cn_status cn_stage_eval(const cn_city *city, const cn_plan *plan, cn_stage *stage);
#endif
