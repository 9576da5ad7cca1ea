/* What was submitted to a cluster, and what its queue says of it. */
#ifndef CONURB_BATCH_QUEUE_H
#define CONURB_BATCH_QUEUE_H
#include "conurb/batch.h"

/* CITY/jobs/submission.json: {"engine": "slurm", "jobs": [{"stage", "id", "items": [...]}]}; items are in the order of
 * the array's tasks, from 1. */
#define CN_SUBMISSION "jobs/submission.json"

/* Puts what squeue says into the rows that a submission speaks of. Silent when nothing was submitted; a note in the log
 * when squeue cannot be asked. */
void cn_queue_join(const cn_context *ctx, const cn_city *city, cn_city_state *state);
#endif
