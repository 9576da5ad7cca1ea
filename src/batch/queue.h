/* The jobs that were submitted to a cluster, and their state in the queue. */
#ifndef CONURB_BATCH_QUEUE_H
#define CONURB_BATCH_QUEUE_H
#include "conurb/batch.h"

/* CITY/jobs/submission.json: {"engine": "slurm", "jobs": [{"stage", "id", "items": [...]}]}; items are in the order of
 * the array's tasks, from 1. */
#define CN_SUBMISSION "jobs/submission.json"

/* Slurm's programs wait very long for a controller that does not answer; they are ended after this time. */
enum { CN_SLURM_LIMIT_S = 20 };

/* Adds squeue's state to the rows of submitted jobs. Does nothing when nothing was submitted, and logs a note where
 * there is no squeue. Where squeue fails or does not answer, state->queue says why the queue is not known. */
void cn_queue_join(const cn_context *ctx, const cn_city *city, cn_city_state *state);
#endif
