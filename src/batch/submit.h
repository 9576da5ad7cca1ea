/* A submission: the stages that are due, as jobs for a cluster. */
#ifndef CONURB_BATCH_SUBMIT_H
#define CONURB_BATCH_SUBMIT_H
#include "conurb/batch.h"
#include "city/workspace.h"

/* ---- fill.c: templates ---- */
typedef struct cn_blank {
    const char *name, *value;
} cn_blank;
/* The template (FOLDER/FILE, or the text embedded under that name when folder is NULL) with every {{name}} replaced;
 * caller frees. blanks ends with a NULL name. CN_ERR_CONFIG names a blank that is not known. */
CN_NODISCARD cn_status cn_template_fill(const char *folder, const char *file, const char *embedded,
                                        const cn_blank *blanks, char **out);
/* As one word of a shell, as one string of YAML; callers free; NULL when out of memory. */
char *cn_shell_word(const char *text);
char *cn_yaml_string(const char *text);
/* As a value in an #SBATCH line; file: of an option that names a file, where % begins a pattern. */
char *cn_sbatch_word(const char *text, bool file);

/* ---- submit.c ---- */
enum { CN_SUBMIT_JOBS = 4 };
/* One stage: a single task, or an array of one task an item. */
typedef struct cn_submit_job {
    const char *stage; /* "prepare", "train", "match", "eval", "render" */
    const char **items;
    uint32_t n; /* borrowed from the graph; n 0: a single task */
    char *list; /* path of a file with an item a line */
    uint32_t cpus, minutes, memory_mb;
} cn_submit_job;
typedef struct cn_submission {
    const cn_context *ctx;
    const cn_city *city;
    const cn_submit_options *options;
    cn_job_graph graph;
    cn_submit_job jobs[CN_SUBMIT_JOBS];
    uint32_t n_jobs;                 /* in the order of their dependencies */
    char *dir;                       /* CITY/jobs */
    char live[512], live_match[512]; /* ":12:13": jobs of earlier submissions that still train tiles, that match them */
} cn_submission;

/* ---- slurm.c, kubernetes.c: write what the engine takes; submit it unless options->dry_run; print by the log ---- */
CN_NODISCARD cn_status cn_submit_slurm(cn_submission *submission);
CN_NODISCARD cn_status cn_submit_kubernetes(cn_submission *submission);
#endif
