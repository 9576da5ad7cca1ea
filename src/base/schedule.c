#include "base/schedule.h"

#include "base/file.h"

#include <math.h>
#include <stdio.h>

#define BUSY 0.1      /* waiting time divided by running time */
#define PARALLEL 0.95 /* fraction of the threads that run at once on an idle machine */

cn_schedule cn_schedule_now(void)
{
    cn_schedule sum = { 0, 0 };
    DIR *tasks = opendir("/proc/self/task");
    cn_status status = CN_OK;
    for (const char *task; tasks && (status = cn_folder_next(tasks, "/proc/self/task", &task)) == CN_OK && task;) {
        char path[300];
        double ran_ns, waited_ns;
        snprintf(path, sizeof path, "/proc/self/task/%s/schedstat", task);
        FILE *file = fopen(path, "r");
        if (file && fscanf(file, "%lf %lf", &ran_ns, &waited_ns) == 2) {
            sum.ran_s += 1e-9 * ran_ns;
            sum.waited_s += 1e-9 * waited_ns;
        }
        if (file) fclose(file);
    }
    if (tasks) closedir(tasks);
    return status == CN_OK ? sum : (cn_schedule){ 0, 0 };
}

double cn_schedule_alone(cn_schedule before, cn_schedule after, unsigned threads, double wall_s)
{
    const double ran = after.ran_s - before.ran_s, waited = after.waited_s - before.waited_s;
    return waited > BUSY * ran && threads > 0 ? fmin(wall_s, ran / (PARALLEL * threads)) : wall_s;
}
