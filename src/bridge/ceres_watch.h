// Progress and stopping of a Ceres run; for C++ files of this folder.
#ifndef CONURB_BRIDGE_CERES_WATCH_H
#define CONURB_BRIDGE_CERES_WATCH_H
#include "conurb/base.h"

#include <ceres/iteration_callback.h>

struct cn_watcher : ceres::IterationCallback {
    const cn_context *ctx;
    const char *stage; // may be NULL
    double total;      // iterations at most
    bool stopped = false;
    cn_watcher(const cn_context *c, const char *s, double n) : ctx(c), stage(s), total(n) {}
    ceres::CallbackReturnType operator()(const ceres::IterationSummary &summary) override
    {
        const double done = summary.iteration, elapsed = summary.cumulative_time_in_seconds;
        const cn_progress_report report = {
            stage ? stage : "adjustment", nullptr, done, total, elapsed, -1, "adjusting"
        };
        cn_progress(ctx, &report);
        stopped = cn_stopping(ctx);
        return stopped ? ceres::SOLVER_ABORT : ceres::SOLVER_CONTINUE;
    }
};
#endif
