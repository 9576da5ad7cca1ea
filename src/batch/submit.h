/* A submission: the stages that are due, as jobs for a cluster. */
#ifndef CONURB_BATCH_SUBMIT_H
#define CONURB_BATCH_SUBMIT_H
#include "conurb/batch.h"
#include "city/workspace.h"

/* ---- fill.c: templates ---- */
typedef struct cn_blank {
    const char *name, *value;
} cn_blank;
/* The template FOLDER/FILE (folder NULL: the built-in text of that name) with every {{name}} replaced; the caller
 * frees it. blanks: the names and values, ended by a NULL name. CN_ERR_CONFIG: an unknown name in the template; the
 * message has it. */
CN_NODISCARD cn_status cn_template_fill(const char *folder, const char *file, const char *embedded,
                                        const cn_blank *blanks, char **out);
/* Quote a text as one shell word, or as one YAML string; the caller frees it; NULL when out of memory. */
char *cn_shell_word(const char *text);
char *cn_yaml_string(const char *text);
/* " --device 'gpu'" for the command line of a task, or "" when no device is asked for; as above. */
char *cn_submit_device_option(const cn_submit_options *options);
/* Quotes a text as a value in an #SBATCH line. file: the option names a file, where % begins a pattern. */
char *cn_sbatch_word(const char *text, bool file);

/* ---- submit.c ---- */
enum { CN_SUBMIT_JOBS = 4, CN_SUBMIT_LIVE = 2048 };
/* The job of one stage: a single task, or an array with one task per item. */
typedef struct cn_submit_job {
    const char *stage; /* "prepare", "group", "merge", "train", "match", "eval", "render" */
    const char **items;
    uint32_t n; /* borrowed from the graph; n 0: a single task */
    char *list; /* path of a file with one item per line */
    uint32_t cpus, minutes, memory_mb;
} cn_submit_job;
typedef struct cn_submission {
    const cn_context *ctx;
    const cn_city *city;
    const cn_submit_options *options;
    cn_job_graph graph;
    cn_submit_job jobs[CN_SUBMIT_JOBS];
    uint32_t n_jobs; /* in the order of their dependencies */
    char *dir;       /* CITY/jobs */
    /* ":12:13": jobs of earlier submissions that still train tiles (or map groups), and that align them */
    char live[CN_SUBMIT_LIVE], live_match[CN_SUBMIT_LIVE];
} cn_submission;

/* Adds to live the jobs of earlier submissions that still run a stage, as ":12:13". Later stages wait for them too. */
void cn_submit_find_live(const cn_city_state *state, const char *stage, char live[CN_SUBMIT_LIVE]);

/* ---- list.c ---- */
/* Writes job->items to a file and fills job->list, which the caller frees. */
CN_NODISCARD cn_status cn_submit_write_list(const cn_submission *submission, cn_submit_job *job);

/* ---- slurm.c, kubernetes.c: write the scripts, submit them unless options->dry_run, and log the commands ---- */
CN_NODISCARD cn_status cn_submit_slurm(cn_submission *submission);
CN_NODISCARD cn_status cn_submit_kubernetes(cn_submission *submission);
#endif
