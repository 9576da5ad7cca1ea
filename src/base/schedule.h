/* Estimates how long some work would take on a machine that does nothing else. */
#ifndef CONURB_BASE_SCHEDULE_H
#define CONURB_BASE_SCHEDULE_H

/* Sums over the process's threads, since it began: seconds on a processor, and seconds of waiting for a processor that
 * another process used. Zero when the system does not report them for every thread (Linux's schedstat). */
typedef struct cn_schedule {
    double ran_s, waited_s;
} cn_schedule;
cn_schedule cn_schedule_now(void);
/* The work took wall_s by the clock. Returns wall_s, unless the threads waited for a processor for more than a tenth
 * of the time they ran. Then it returns the time that they ran, divided by `threads`. Threads that ended in between
 * are left out. */
double cn_schedule_alone(cn_schedule before, cn_schedule after, unsigned threads, double wall_s);
#endif
