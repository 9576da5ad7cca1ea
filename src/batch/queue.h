/* The jobs that were submitted to a cluster, and their state in the queue. */
#ifndef CONURB_BATCH_QUEUE_H
#define CONURB_BATCH_QUEUE_H
#include "conurb/batch.h"

/* CITY/jobs/submission.json: {"engine": "slurm", "jobs": [{"stage", "id", "items": [...]}]}; items are in the order of
 * the array's tasks, from 1. */
#define CN_SUBMISSION "jobs/submission.json"

/* Adds squeue's state to the rows of submitted jobs. Does nothing when nothing was submitted; logs a note when squeue
 * cannot be run. */
void cn_queue_join(const cn_context *ctx, const cn_city *city, cn_city_state *state);
#endif
