// Global positioning by Ceres, behind bridge/ceres.h. Every exception stops here.
#include "bridge/ceres.h"

#include "bridge/ceres_watch.h"

#include <ceres/ceres.h>
#include <glog/logging.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <exception>
#include <memory>
#include <new>
#include <vector>

namespace
{

constexpr double kLoss = 0.1; // of Huber's loss, and the least d: GLOMAP's
constexpr double kLeastScale = 1e-5;

// direction - scale * (point - centre), with its derivatives by hand: there are many, and they are simple.
struct bearing_cost : ceres::SizedCostFunction<3, 3, 3, 1> {
    const double *direction;
    explicit bearing_cost(const double *d) : direction(d) {}
    bool Evaluate(double const *const *parameters, double *residuals, double **jacobians) const override
    {
        const double *centre = parameters[0], *point = parameters[1], scale = *parameters[2];
        for (int i = 0; i < 3; i++)
            residuals[i] = direction[i] - scale * (point[i] - centre[i]);
        if (!jacobians) return true;
        for (int i = 0; i < 3; i++) {
            for (int j = 0; j < 3; j++) {
                if (jacobians[0]) jacobians[0][3 * i + j] = i == j ? scale : 0;
                if (jacobians[1]) jacobians[1][3 * i + j] = i == j ? -scale : 0;
            }
            if (jacobians[2]) jacobians[2][i] = centre[i] - point[i];
        }
        return true;
    }
};

struct placing {
    std::vector<std::array<double, 3>> centres, points;
    std::vector<double> scales;
    std::vector<std::unique_ptr<bearing_cost>> costs;
    ceres::HuberLoss loss{ kLoss };
};

ceres::Problem::Options ownership()
{
    ceres::Problem::Options o;
    o.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
    o.cost_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
    return o;
}

bool finite(const std::vector<std::array<double, 3>> &places)
{
    return std::all_of(places.begin(), places.end(),
                       [](const auto &p) { return std::isfinite(p[0]) && std::isfinite(p[1]) && std::isfinite(p[2]); });
}

cn_status check(const cn_bearings *p)
{
    for (uint64_t i = 0; i < p->n_bearings; i++) {
        const cn_bearing &b = p->bearings[i];
        if (b.centre >= p->n_centres || b.point >= p->n_points)
            return cn_fail(CN_ERR_DATA, "a direction names a camera or a point that is not there");
        if (!std::isfinite(b.direction[0] + b.direction[1] + b.direction[2]))
            return cn_fail(CN_ERR_DATA, "a direction is not finite");
    }
    return p->n_bearings ? CN_OK : cn_fail(CN_ERR_DATA, "there are no directions");
}

cn_status place(const cn_context *ctx, const cn_bearings *p, const cn_adjust_options *options, cn_adjust_result *result)
{
    placing w;
    ceres::Problem problem(ownership());
    w.centres.resize(p->n_centres);
    w.points.resize(p->n_points);
    for (uint32_t i = 0; i < p->n_centres; i++)
        std::copy_n(p->centres[i], 3, w.centres[i].begin());
    for (uint32_t i = 0; i < p->n_points; i++)
        std::copy_n(p->points[i], 3, w.points[i].begin());
    w.scales.assign(p->n_bearings, 1.0);
    // Scales are eliminated first, each alone in its residual; then points; see solver_options in ceres.cpp on order.
    ceres::Solver::Options how;
    how.linear_solver_ordering = std::make_shared<ceres::ParameterBlockOrdering>();
    for (uint64_t i = 0; i < p->n_bearings; i++) {
        const cn_bearing &b = p->bearings[i];
        w.costs.push_back(std::make_unique<bearing_cost>(b.direction));
        double *centre = w.centres[b.centre].data(), *point = w.points[b.point].data();
        problem.AddResidualBlock(w.costs.back().get(), &w.loss, centre, point, &w.scales[i]);
        problem.SetParameterLowerBound(&w.scales[i], 0, kLeastScale);
        how.linear_solver_ordering->AddElementToGroup(&w.scales[i], 0);
        how.linear_solver_ordering->AddElementToGroup(point, 1);
        how.linear_solver_ordering->AddElementToGroup(centre, 2);
    }
    how.linear_solver_type = ceres::SPARSE_SCHUR;
    how.max_num_iterations = static_cast<int>(options->max_iterations);
    how.num_threads = options->n_threads ? static_cast<int>(options->n_threads) : 1;
    how.function_tolerance = 1e-5;
    how.logging_type = ceres::SILENT;
    cn_watcher watch(ctx, options->stage, options->max_iterations);
    how.callbacks.push_back(&watch);
    ceres::Solver::Summary summary;
    ceres::Solve(how, &problem, &summary);
    if (watch.stopped) return cn_fail(CN_ERR_INTERRUPTED, "stopped while placing cameras; run the same command again");
    if (!summary.IsSolutionUsable() || !finite(w.centres) || !finite(w.points))
        return cn_fail(CN_ERR_DATA, "placing %u cameras: %s", p->n_centres, summary.message.c_str());
    *result = { static_cast<uint32_t>(summary.iterations.size()), summary.termination_type == ceres::CONVERGENCE,
                summary.final_cost, summary.initial_cost, 0 };
    for (uint32_t i = 0; i < p->n_centres; i++)
        std::copy(w.centres[i].begin(), w.centres[i].end(), p->centres[i]);
    for (uint32_t i = 0; i < p->n_points; i++)
        std::copy(w.points[i].begin(), w.points[i].end(), p->points[i]);
    return CN_OK;
}

} // namespace

extern "C" cn_status cn_ceres_place(const cn_context *ctx, const cn_bearings *problem, const cn_adjust_options *options,
                                    cn_adjust_result *result)
{
    *result = {};
    try {
        FLAGS_minloglevel = google::GLOG_FATAL;
        CN_TRY(check(problem));
        return place(ctx, problem, options, result);
    } catch (const std::bad_alloc &) {
        return cn_fail(CN_ERR_NOMEM, "out of memory placing %u cameras", problem->n_centres);
    } catch (const std::exception &e) {
        return cn_fail(CN_ERR_INTERNAL, "placing cameras: %s", e.what());
    } catch (...) {
        return cn_fail(CN_ERR_INTERNAL, "placing cameras: unknown exception from Ceres");
    }
}
