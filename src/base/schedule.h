/* What a stretch of work would take on a machine that does nothing else. */
#ifndef CONURB_BASE_SCHEDULE_H
#define CONURB_BASE_SCHEDULE_H

/* Since the process began, summed over its threads: seconds on a processor, and seconds of waiting for one that
 * something else had. Zero where the system does not tell (Linux's schedstat), or not of every thread. */
typedef struct cn_schedule {
    double ran_s, waited_s;
} cn_schedule;
cn_schedule cn_schedule_now(void);
/* The clock says that a stretch of work took wall_s. That stands, unless the threads waited for a processor for more
 * than a tenth of what they ran: then the time that they ran, shared among `threads`. Threads that ended between are
 * left out. */
double cn_schedule_alone(cn_schedule before, cn_schedule after, unsigned threads, double wall_s);
#endif
