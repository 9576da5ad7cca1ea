/* conurb/batch.h: a city as a batch of jobs: what is due, how far it is, and its submission to a cluster.
 * One thread a call. Strings and lists that a call fills in belong to the caller until the _deinit. */
#ifndef CONURB_BATCH_H
#define CONURB_BATCH_H
#include "conurb/base.h"
#include "conurb/job.h"
#ifdef __cplusplus
extern "C" {
#endif

/* ---- the graph: poses -> plan -> train[tile] -> eval, render[chunk] ---- */
enum { CN_CHUNK_FRAMES = 16 }; /* of the default flight: frames of one render node */
typedef struct cn_job_node {
    char stage[16];          /* "poses", "plan", "train", "eval", "render" */
    char item[48];           /* tile id; "1/3" for a chunk; "" */
    bool done;
    char reason[256];        /* why it is not: "train.steps is 60, was 40", "tile X comes first"; "" when it is done */
    double estimate_s;       /* on one processor; 0 where unknown */
    uint64_t estimate_bytes; /* memory; 0 where unknown */
} cn_job_node;
typedef struct cn_job_graph { cn_job_node *nodes; uint32_t n; uint32_t n_due; } cn_job_graph;
/* quality < 0: from city.yaml. quick: trusts that the photos have not changed since the poses were made, for reading them all takes
 * long. Writes nothing. */
CN_API CN_NODISCARD cn_status cn_city_graph(const cn_context *ctx, cn_city *city, int quality, bool quick, cn_job_graph *graph);
CN_API void cn_job_graph_deinit(cn_job_graph *graph);

#ifdef __cplusplus
}
#endif
#endif
