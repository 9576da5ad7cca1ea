/* One folder in which COLMAP works, stage by stage: its runs, their progress, and markers of what is done. */
#ifndef CONURB_POSE_COLMAP_JOB_H
#define CONURB_POSE_COLMAP_JOB_H
#include "conurb/pose.h"

/* How an attempt differs from COLMAP's defaults. Lists of words end with NULL; NULL: none. */
typedef struct cn_colmap_way {
    const char *const *features, *const *matches, *const *mapper; /* further options of each program */
    bool simple_camera;                                           /* SIMPLE_RADIAL even for many photos of one lens */
    bool every_pair; /* matches all pairs of collections up to some size, whatever their GPS */
} cn_colmap_way;

typedef struct cn_colmap_job {
    const cn_context *ctx;
    const cn_photo_index *index;
    const cn_pose_options *options;
    const cn_colmap_way *way;
    const char *dir;
    char *log, *database, *images; /* images: folder that COLMAP reads */
    char *note;                    /* file that names the running COLMAP */
    char threads[16];
    size_t most_bytes; /* of descriptors in memory while pairs are matched here; 0: half a gigabyte */
    bool linked;
    uint64_t chain; /* hash of all inputs up to this stage */
    const char *stage;
    double started_s, base, part, done, total; /* part: the fraction of the total that this run of COLMAP does */
    double told_s, advanced_s;                 /* time of the last report; of the last progress */
    double step_s, left_s;                     /* recent seconds per unit of `done`; time left at the last progress */
    char photo[256], last[512];                /* photo being read; last line, or last error */
    bool error_seen;
} cn_colmap_job;

/* Starts a stage with `total` units of progress. */
void cn_job_begin(cn_colmap_job *j, const char *stage, double total);
/* Adds inputs of the stage to the chain. */
void cn_job_mix(cn_colmap_job *j, const void *data, size_t size);
void cn_job_mix_words(cn_colmap_job *j, const char *const *words);
void cn_job_tell(cn_colmap_job *j, double done);
/* Appends words to a command line with room for CN_JOB_WORDS, and ends it with NULL. */
enum { CN_JOB_WORDS = 64 };
void cn_job_words(const char **argv, int *n, const char *const *words);
/* Runs COLMAP. argv: less than CN_JOB_WORDS words, with the names that options have in COLMAP 3.8. CN_ERR_TOOL: it
 * cannot be started. */
CN_NODISCARD cn_status cn_job_run(cn_colmap_job *j, const char *const *argv, int *exit_code);
/* The failure of a run that ended with this exit code. */
CN_NODISCARD cn_status cn_job_failed(const cn_colmap_job *j, int exit_code);

/* Marker files: the hash of the inputs for which a stage was begun or finished. */
char *cn_job_marker(const cn_colmap_job *j, const char *stage, const char *what); /* path; caller frees */
bool cn_job_is_marked(const cn_colmap_job *j, const char *what);
bool cn_job_is_done(const cn_colmap_job *j);
CN_NODISCARD cn_status cn_job_mark(const cn_colmap_job *j, const char *what);
CN_NODISCARD cn_status cn_job_mark_done(const cn_colmap_job *j);
CN_NODISCARD cn_status cn_job_remove_marker(const cn_colmap_job *j, const char *stage, const char *what);
CN_NODISCARD cn_status cn_job_unmark(const cn_colmap_job *j);
#endif
