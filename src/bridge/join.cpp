// Similarities of models by Ceres, behind bridge/join.h. Every exception stops here.
#include "bridge/join.h"

#include <ceres/ceres.h>
#include <ceres/rotation.h>
#include <glog/logging.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <exception>
#include <new>
#include <vector>

namespace
{

constexpr double kLossSigmas = 3;
constexpr int kMostSteps = 100;

// What is changed: a turn on top of the rotation at the start, the place, and the logarithm of the scale.
using state = std::array<double, 7>;

template <typename T> void apply(const cn_join_model &m, const T *s, const double at[3], T out[3])
{
    T turned[3];
    for (int i = 0; i < 3; i++) {
        double sum = 0;
        for (int k = 0; k < 3; k++)
            sum += m.rotation[3 * i + k] * (at[k] - m.centre[k]);
        turned[i] = T(sum);
    }
    ceres::AngleAxisRotatePoint(s, turned, out);
    const T scale = exp(s[6]);
    for (int i = 0; i < 3; i++)
        out[i] = scale * out[i] + s[3 + i];
}

struct tie_cost {
    const cn_join_model *a, *b;
    const cn_join_tie *tie;
    template <typename T> bool operator()(const T *sa, const T *sb, T *residual) const
    {
        T pa[3], pb[3];
        apply(*a, sa, tie->in_a, pa);
        apply(*b, sb, tie->in_b, pb);
        for (int i = 0; i < 3; i++)
            residual[i] = (pa[i] - pb[i]) / tie->sigma;
        return true;
    }
};

struct anchor_cost {
    const cn_join_model *model;
    const cn_join_anchor *anchor;
    template <typename T> bool operator()(const T *s, T *residual) const
    {
        T at[3];
        apply(*model, s, anchor->at, at);
        for (int i = 0; i < 3; i++)
            residual[i] = anchor->sigma[i] > 0 ? (at[i] - anchor->place[i]) / anchor->sigma[i] : T(0);
        return true;
    }
};

bool finite3(const double *v)
{
    return std::isfinite(v[0]) && std::isfinite(v[1]) && std::isfinite(v[2]);
}

cn_status check(const cn_join_problem *p)
{
    for (uint32_t i = 0; i < p->n_models; i++) {
        const cn_join_model &m = p->models[i];
        const bool turned = std::all_of(m.rotation, m.rotation + 9, [](double x) { return std::isfinite(x); });
        if (!(m.scale > 0) || !std::isfinite(m.scale) || !turned || !finite3(m.centre) || !finite3(m.place))
            return cn_fail(CN_ERR_DATA, "joining models: model %u is not finite", i);
    }
    for (size_t i = 0; i < p->n_ties; i++) {
        const cn_join_tie &t = p->ties[i];
        if (t.a >= p->n_models || t.b >= p->n_models || t.a == t.b || !finite3(t.in_a) || !finite3(t.in_b) ||
            !(t.sigma > 0))
            return cn_fail(CN_ERR_DATA, "joining models: tie %zu is not finite, or names no two models", i);
    }
    for (size_t i = 0; i < p->n_anchors; i++) {
        const cn_join_anchor &a = p->anchors[i];
        if (a.model >= p->n_models || !finite3(a.at) || !finite3(a.place) || !finite3(a.sigma))
            return cn_fail(CN_ERR_DATA, "joining models: anchor %zu is not finite, or names no model", i);
    }
    return CN_OK;
}

struct watcher : ceres::IterationCallback {
    const cn_context *ctx;
    bool stopped = false;
    explicit watcher(const cn_context *c) : ctx(c) {}
    ceres::CallbackReturnType operator()(const ceres::IterationSummary &summary) override
    {
        const cn_progress_report report = { "poses",
                                            nullptr,
                                            double(summary.iteration),
                                            double(kMostSteps),
                                            summary.cumulative_time_in_seconds,
                                            -1,
                                            "placing the groups" };
        cn_progress(ctx, &report);
        stopped = cn_stopping(ctx);
        return stopped ? ceres::SOLVER_ABORT : ceres::SOLVER_CONTINUE;
    }
};

void take_back(const cn_join_problem *p, const std::vector<state> &states)
{
    for (uint32_t i = 0; i < p->n_models; i++) {
        cn_join_model &m = p->models[i];
        if (m.fixed) continue;
        double turn[9], was[9];
        std::copy_n(m.rotation, 9, was);
        ceres::AngleAxisToRotationMatrix(states[i].data(), ceres::RowMajorAdapter3x3(turn));
        for (int r = 0; r < 3; r++)
            for (int c = 0; c < 3; c++)
                m.rotation[3 * r + c] =
                    turn[3 * r] * was[c] + turn[3 * r + 1] * was[3 + c] + turn[3 * r + 2] * was[6 + c];
        std::copy_n(states[i].data() + 3, 3, m.place);
        m.scale = std::exp(states[i][6]);
    }
}

cn_status join(const cn_context *ctx, const cn_join_problem *p)
{
    ceres::Problem::Options ownership;
    ownership.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
    ceres::CauchyLoss loss(kLossSigmas);
    ceres::Problem problem(ownership);
    std::vector<state> states(p->n_models);
    for (uint32_t i = 0; i < p->n_models; i++) {
        const cn_join_model &m = p->models[i];
        states[i] = { 0, 0, 0, m.place[0], m.place[1], m.place[2], std::log(m.scale) };
        problem.AddParameterBlock(states[i].data(), 7);
        if (m.fixed) problem.SetParameterBlockConstant(states[i].data());
    }
    for (size_t i = 0; i < p->n_ties; i++) {
        const cn_join_tie &t = p->ties[i];
        problem.AddResidualBlock(
            new ceres::AutoDiffCostFunction<tie_cost, 3, 7, 7>(new tie_cost{ &p->models[t.a], &p->models[t.b], &t }),
            &loss, states[t.a].data(), states[t.b].data());
    }
    for (size_t i = 0; i < p->n_anchors; i++) {
        const cn_join_anchor &a = p->anchors[i];
        problem.AddResidualBlock(
            new ceres::AutoDiffCostFunction<anchor_cost, 3, 7>(new anchor_cost{ &p->models[a.model], &a }), &loss,
            states[a.model].data());
    }
    watcher watch(ctx);
    ceres::Solver::Options o;
    o.linear_solver_type = ceres::SPARSE_NORMAL_CHOLESKY;
    o.max_num_iterations = kMostSteps;
    o.function_tolerance = 1e-8;
    o.logging_type = ceres::SILENT;
    o.callbacks.push_back(&watch);
    ceres::Solver::Summary summary;
    ceres::Solve(o, &problem, &summary);
    if (watch.stopped)
        return cn_fail(CN_ERR_INTERRUPTED, "stopped while placing groups; run the same command to resume");
    const bool good = std::all_of(states.begin(), states.end(), [](const state &s) {
        return std::all_of(s.begin(), s.end(), [](double x) { return std::isfinite(x); });
    });
    if (!summary.IsSolutionUsable() || !good)
        return cn_fail(CN_ERR_DATA, "joining %u models: %s", p->n_models, summary.message.c_str());
    take_back(p, states);
    return CN_OK;
}

} // namespace

extern "C" cn_status cn_ceres_join(const cn_context *ctx, const cn_join_problem *problem)
{
    try {
        FLAGS_minloglevel = google::GLOG_FATAL;
        CN_TRY(check(problem));
        return join(ctx, problem);
    } catch (const std::bad_alloc &) {
        return cn_fail(CN_ERR_NOMEM, "out of memory joining %u models", problem->n_models);
    } catch (const std::exception &e) {
        return cn_fail(CN_ERR_INTERNAL, "joining models: %s", e.what());
    } catch (...) {
        return cn_fail(CN_ERR_INTERNAL, "joining models: unknown exception from Ceres");
    }
}
