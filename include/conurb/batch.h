/* conurb/batch.h: a city as a set of jobs: which are due, how far they are, and how to submit them to a cluster.
 *
 * Threads: no two calls on the same city at the same time. Lists that a call fills are owned by the caller, who frees
 * them with the matching _deinit. */
#ifndef CONURB_BATCH_H
#define CONURB_BATCH_H
#include "conurb/base.h"
#include "conurb/stage.h"
#ifdef __cplusplus
extern "C" {
#endif

/* ---- the job graph: group[number] -> poses -> plan -> train[tile] -> eval, match -> render[chunk] ----
 *
 * A city whose photos are posed at once has no groups; a city of one tile has no match. */
enum { CN_CHUNK_FRAMES = 16 }; /* frames of the default flight in one render node */
typedef struct cn_job_node {
    char stage[16]; /* "group", "poses", "plan", "train", "match", "eval", "render" */
    char item[48];  /* the tile's id; for a chunk "1/3"; a group's number, from 1; else "" */
    bool done;
    bool failed;             /* a group that was tried, and that the others need not wait for */
    char reason[256];        /* why it is not done: "train.steps is 60, was 40", "tile X comes first"; "" when done */
    double estimate_s;       /* seconds on one processor; 0 when unknown */
    bool budgeted;           /* estimate_s is a budget of time, on any number of processors */
    uint64_t estimate_bytes; /* bytes of memory; 0 when unknown */
} cn_job_node;
typedef struct cn_job_graph {
    cn_job_node *nodes;
    uint32_t n;
    uint32_t n_due;
} cn_job_graph;
/* Lists the jobs of a city. quality and time_budget_s are as in cn_city_train. quick: assume that the photos have not
 * changed since the poses were made; checking means reading every photo, which takes long. Writes nothing. */
CN_API CN_NODISCARD cn_status cn_city_graph(const cn_context *ctx, cn_city *city, int quality, double time_budget_s,
                                            bool quick, cn_job_graph *graph);
CN_API void cn_job_graph_deinit(cn_job_graph *graph);

/* ---- the state of the jobs, from the disk and from the cluster's queue ---- */
typedef enum cn_work {
    CN_WORK_WAITING, /* nothing has been written yet */
    CN_WORK_QUEUED,  /* it is in a cluster's queue */
    CN_WORK_RUNNING,
    CN_WORK_STOPPED, /* stopped; it resumes from its checkpoint in the next run */
    CN_WORK_LOST,    /* its process ended without a message: it was killed, or its machine failed */
    CN_WORK_FAILED,
    CN_WORK_DONE /* done, perhaps with other settings; cn_city_graph compares the settings */
} cn_work;
CN_API const char *cn_work_name(cn_work work); /* "waiting", ... */
typedef struct cn_work_row {
    char stage[16], item[48];
    cn_work work;
    double done, total;         /* steps of a tile, frames of a render; total is 0 when unknown */
    double psnr, samples_per_s; /* psnr in dB, on the training photos; NaN when unknown */
    double left_s;              /* < 0 when unknown */
    double memory_bytes;        /* resident memory; for a done tile, its training memory; 0 when unknown */
    double heartbeat_s;         /* seconds since the job's process last wrote its heartbeat; < 0 when there is none */
    char where[96];             /* "host, pid 17", or what the queue says: "job 12_3 PENDING (Resources)" */
    char note[256];             /* why it failed, or that it has made no progress for a long time; else "" */
} cn_work_row;
typedef struct cn_city_state {
    cn_work_row *rows;
    uint32_t n;
    uint32_t n_tiles, tiles[CN_WORK_DONE + 1]; /* tiles[w]: number of tiles in state w */
    double left_s;                             /* the longest time left of the running jobs; < 0 when unknown */
    char queue[256]; /* why the state of submitted jobs in the cluster's queue is not known; "" when it is */
} cn_city_state;
/* Reads the state from the disk, and from squeue when jobs were submitted to Slurm. Takes no lock and writes nothing.
 * Cheap enough for every second. */
CN_API CN_NODISCARD cn_status cn_city_state_read(const cn_context *ctx, cn_city *city, cn_city_state *state);
CN_API void cn_city_state_deinit(cn_city_state *state);
/* The state as JSON: {"tiles": {...}, "rows": [...], "queue": "..."}. The caller frees *json with free(). */
CN_API CN_NODISCARD cn_status cn_city_state_json(const cn_city_state *state, char **json);

/* ---- clusters ---- */
typedef enum cn_engine { CN_ENGINE_SLURM, CN_ENGINE_KUBERNETES } cn_engine;
typedef struct cn_submit_options {
    cn_engine engine;
    bool dry_run;             /* write the scripts, submit nothing */
    uint32_t max_tasks;       /* tasks of one stage at the same time; 0: no limit but the cluster's own */
    uint32_t cpus;            /* processors for each task; 0: from the plan's estimate */
    const char *template_dir; /* folder with slurm.sbatch or kubernetes.yaml; NULL: the built-in templates */
    const char *program;      /* the conurb program that the tasks run: an absolute path, valid on the cluster;
                               * NULL, for Kubernetes: that of the image */
    const char *quality;      /* training preset, by name; NULL: from city.yaml */
    const char *device;       /* the tasks' --device, as in cn_device_create; NULL: what each task chooses */
} cn_submit_options;
/* Writes one script for each stage to CITY/jobs. A city whose photos are posed in groups gets an array of the groups
 * and a job that merges them. Submits the stages that are due and not yet in the queue, and records
 * them in CITY/jobs/submission.json. Without a valid plan it submits one job, which makes the poses and the plan and
 * then (Slurm) submits the rest. Kubernetes has no order among jobs and gets only those that can begin; when they have
 * ended, submit again. The log shows the commands. CN_ERR_TOOL: the cluster's program is missing, or it refuses the
 * job; or what is in the queue is not known, so that jobs might be submitted twice (dry_run: a warning). */
CN_API CN_NODISCARD cn_status cn_city_submit(const cn_context *ctx, cn_city *city, const cn_submit_options *options);

/* ---- what this machine has, and what it lacks ---- */
typedef struct cn_check {
    char name[24];
    bool good;
    char found[1024], lack[256];
} cn_check; /* found: what is there; lack: what its absence means, "" when good */
typedef struct cn_checks {
    cn_check *list;
    uint32_t n;
} cn_checks;
/* Checks this machine. folder: where a city is or will be. A test file of 64 MiB is written there, to measure the
 * disk, and removed. */
CN_API CN_NODISCARD cn_status cn_doctor(const cn_context *ctx, const char *folder, cn_checks *checks);
CN_API void cn_checks_deinit(cn_checks *checks);

#ifdef __cplusplus
}
#endif
#endif
