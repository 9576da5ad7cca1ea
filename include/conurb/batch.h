/* conurb/batch.h: a city as a batch of jobs: what is due, how far it is, and its submission to a cluster.
 * One thread a call. Strings and lists that a call fills in belong to the caller until the _deinit. */
#ifndef CONURB_BATCH_H
#define CONURB_BATCH_H
#include "conurb/base.h"
#include "conurb/stage.h"
#ifdef __cplusplus
extern "C" {
#endif

/* ---- the graph: poses -> plan -> train[tile] -> eval, match -> render[chunk]; a single tile has no match ---- */
enum { CN_CHUNK_FRAMES = 16 }; /* of the default flight: frames of one render node */
typedef struct cn_job_node {
    char stage[16]; /* "poses", "plan", "train", "match", "eval", "render" */
    char item[48];  /* tile id; "1/3" for a chunk; "" */
    bool done;
    char reason[256];        /* why it is not: "train.steps is 60, was 40", "tile X comes first"; "" when it is done */
    double estimate_s;       /* on one processor; 0 where unknown */
    uint64_t estimate_bytes; /* memory; 0 where unknown */
} cn_job_node;
typedef struct cn_job_graph {
    cn_job_node *nodes;
    uint32_t n;
    uint32_t n_due;
} cn_job_graph;
/* quality and time_budget_s as in cn_city_train. quick: trusts that the photos have not changed since the poses were
 * made, for reading them all takes long. Writes nothing. */
CN_API CN_NODISCARD cn_status cn_city_graph(const cn_context *ctx, cn_city *city, int quality, double time_budget_s,
                                            bool quick, cn_job_graph *graph);
CN_API void cn_job_graph_deinit(cn_job_graph *graph);

/* ---- what is on the disk, and what the queue says ---- */
typedef enum cn_work {
    CN_WORK_WAITING, /* nothing there yet */
    CN_WORK_QUEUED,  /* a cluster's queue holds it */
    CN_WORK_RUNNING,
    CN_WORK_STOPPED, /* goes on from its checkpoint when it is run again */
    CN_WORK_LOST,    /* its process ended without a word: killed, or its machine died */
    CN_WORK_FAILED,
    CN_WORK_DONE /* of some settings; cn_city_graph says whether of these */
} cn_work;
CN_API const char *cn_work_name(cn_work work); /* "waiting", ... */
typedef struct cn_work_row {
    char stage[16], item[48];
    cn_work work;
    double done, total;         /* steps of a tile, frames of a render; total 0 when unknown */
    double psnr, samples_per_s; /* of training photos; NaN when unknown */
    double left_s;              /* < 0 when unknown */
    double memory_bytes;        /* resident now, or of a done tile its arena; 0 when unknown */
    double heartbeat_s;         /* since the holder was last heard of; < 0 when there is none */
    char where[96];             /* "host, pid 17", or the queue's word: "job 12_3 PENDING (Resources)" */
    char note[256];             /* why it failed, that nothing has moved for long; "" */
} cn_work_row;
typedef struct cn_city_state {
    cn_work_row *rows;
    uint32_t n;
    uint32_t n_tiles, tiles[CN_WORK_DONE + 1]; /* how many tiles are in each state */
    double left_s;                             /* the longest of what runs; < 0 when unknown */
} cn_city_state;
/* Reads the disk, and asks squeue when something was submitted to Slurm; takes no lock, writes nothing. Cheap enough to
 * ask every second or two. */
CN_API CN_NODISCARD cn_status cn_city_state_read(const cn_context *ctx, cn_city *city, cn_city_state *state);
CN_API void cn_city_state_deinit(cn_city_state *state);
/* {"tiles": {...}, "rows": [...]}; caller frees. */
CN_API CN_NODISCARD cn_status cn_city_state_json(const cn_city_state *state, char **json);

/* ---- clusters ---- */
typedef enum cn_engine { CN_ENGINE_SLURM, CN_ENGINE_KUBERNETES } cn_engine;
typedef struct cn_submit_options {
    cn_engine engine;
    bool dry_run;             /* write the scripts, hand over nothing */
    uint32_t max_tasks;       /* of a stage at once; 0: as many as there is room for */
    uint32_t cpus;            /* of a task; 0: from the plan's estimate */
    const char *template_dir; /* holds slurm.sbatch or kubernetes.yaml; NULL: those that are built in */
    const char *program;      /* the conurb that the tasks run; an absolute path where the cluster sees it */
    const char *quality;      /* of training, as the command line says it; NULL: city.yaml's */
} cn_submit_options;
/* Writes a script a stage to CITY/jobs, and submits those stages that are due and not in the queue already; records
 * them in CITY/jobs/submission.json. Without a valid plan that is one job, which makes poses and plan and then submits
 * the rest. The log has the commands. CN_ERR_TOOL when the cluster's program is missing or refuses. */
CN_API CN_NODISCARD cn_status cn_city_submit(const cn_context *ctx, cn_city *city, const cn_submit_options *options);

/* ---- what this machine has and lacks ---- */
typedef struct cn_check {
    char name[24];
    bool good;
    char found[256], lack[256];
} cn_check; /* lack: what the lack means, "" when good */
typedef struct cn_checks {
    cn_check *list;
    uint32_t n;
} cn_checks;
/* folder: where a city is or will be, for its disk; 64 MiB are written there and removed. */
CN_API CN_NODISCARD cn_status cn_doctor(const cn_context *ctx, const char *folder, cn_checks *checks);
CN_API void cn_checks_deinit(cn_checks *checks);

#ifdef __cplusplus
}
#endif
#endif
