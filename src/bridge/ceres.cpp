// Ceres behind bridge/ceres.h. Every exception stops here.
#include "bridge/ceres.h"

#include "bridge/ceres_watch.h"

#include <ceres/ceres.h>
#include <ceres/normal_prior.h>
#include <ceres/rotation.h>
#include <glog/logging.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <exception>
#include <memory>
#include <new>
#include <vector>

namespace
{

// ---- Lenses: (u, v, w) in the camera's frame to pixels, with COLMAP's parameters ----

template <typename T> void perspective(const T p[3], T uv[2])
{
    uv[0] = p[0] / p[2];
    uv[1] = p[1] / p[2];
}

template <int Lens> struct lens;
template <> struct lens<0> {
    static constexpr int n = 3;
    template <typename T> static void project(const T *k, const T p[3], T xy[2])
    {
        T uv[2];
        perspective(p, uv);
        xy[0] = k[0] * uv[0] + k[1];
        xy[1] = k[0] * uv[1] + k[2];
    }
};
template <> struct lens<1> {
    static constexpr int n = 4;
    template <typename T> static void project(const T *k, const T p[3], T xy[2])
    {
        T uv[2];
        perspective(p, uv);
        xy[0] = k[0] * uv[0] + k[2];
        xy[1] = k[1] * uv[1] + k[3];
    }
};
template <> struct lens<2> {
    static constexpr int n = 4;
    template <typename T> static void project(const T *k, const T p[3], T xy[2])
    {
        T uv[2];
        perspective(p, uv);
        const T radial = 1.0 + k[3] * (uv[0] * uv[0] + uv[1] * uv[1]);
        xy[0] = k[0] * uv[0] * radial + k[1];
        xy[1] = k[0] * uv[1] * radial + k[2];
    }
};
template <> struct lens<3> {
    static constexpr int n = 5;
    template <typename T> static void project(const T *k, const T p[3], T xy[2])
    {
        T uv[2];
        perspective(p, uv);
        const T s = uv[0] * uv[0] + uv[1] * uv[1], radial = 1.0 + s * (k[3] + s * k[4]);
        xy[0] = k[0] * uv[0] * radial + k[1];
        xy[1] = k[0] * uv[1] * radial + k[2];
    }
};
template <> struct lens<4> {
    static constexpr int n = 8;
    template <typename T> static void project(const T *k, const T p[3], T xy[2])
    {
        T uv[2];
        perspective(p, uv);
        const T &u = uv[0], &v = uv[1], s = u * u + v * v, radial = 1.0 + s * (k[4] + s * k[5]);
        xy[0] = k[0] * (u * radial + 2.0 * k[6] * u * v + k[7] * (s + 2.0 * u * u)) + k[2];
        xy[1] = k[1] * (v * radial + 2.0 * k[7] * u * v + k[6] * (s + 2.0 * v * v)) + k[3];
    }
};
template <> struct lens<5> {
    static constexpr int n = 8;
    template <typename T> static void project(const T *k, const T p[3], T xy[2])
    {
        const T square = p[0] * p[0] + p[1] * p[1];
        T scale = 1.0 / p[2];
        // The derivative of a root is infinite at 0; there the angle over the radius is 1 / p[2].
        if (square > T(1e-20)) {
            const T r = sqrt(square), angle = atan2(r, p[2]), s = angle * angle;
            scale = angle * (1.0 + s * (k[4] + s * (k[5] + s * (k[6] + s * k[7])))) / r;
        }
        xy[0] = k[0] * p[0] * scale + k[2];
        xy[1] = k[1] * p[1] * scale + k[3];
    }
};

// ---- Residuals ----

// A pose that is being adjusted: a turn on top of the rotation that it began with, and its centre. The turn stays
// small, so three numbers describe it well.
struct pose_state {
    const double *begin; // the rotation at the start
    double values[6];    // turn (angle times axis), centre
};

template <typename T> void to_camera(const double *begin, const T *pose, const T *point, T cam[3])
{
    T from[3], turned[3];
    for (int i = 0; i < 3; i++)
        from[i] = point[i] - pose[3 + i];
    for (int i = 0; i < 3; i++)
        turned[i] = begin[3 * i] * from[0] + begin[3 * i + 1] * from[1] + begin[3 * i + 2] * from[2];
    ceres::AngleAxisRotatePoint(pose, turned, cam);
}

template <int Lens> struct reprojection {
    const double *begin;
    float x, y, sigma;
    template <typename T> bool operator()(const T *camera, const T *pose, const T *point, T *residual) const
    {
        T cam[3], xy[2];
        to_camera(begin, pose, point, cam);
        lens<Lens>::project(camera, cam, xy);
        residual[0] = (xy[0] - double(x)) / double(sigma);
        residual[1] = (xy[1] - double(y)) / double(sigma);
        return true;
    }
};

// A picture of all directions, width and height as parameters. Its left and right edge are one, and a row is the
// shorter the nearer it lies to a pole: the error is that of the direction, in pixels of the middle row.
struct sphere_reprojection {
    const double *begin;
    float x, y, sigma;
    template <typename T> bool operator()(const T *camera, const T *pose, const T *point, T *residual) const
    {
        constexpr double pi = 3.14159265358979323846;
        T cam[3];
        to_camera(begin, pose, point, cam);
        const T level = sqrt(cam[0] * cam[0] + cam[2] * cam[2] + 1e-30), azimuth = atan2(cam[0], cam[2]);
        const T seen = (double(x) / camera[0] - 0.5) * 2.0 * pi, height = (double(y) / camera[1] - 0.5) * pi;
        T turn = azimuth - seen;
        if (turn > T(pi)) turn -= 2.0 * pi;
        if (turn < T(-pi)) turn += 2.0 * pi;
        residual[0] = turn * cos(height) * camera[0] / (2.0 * pi * double(sigma));
        residual[1] = (atan2(cam[1], level) - height) * camera[1] / (pi * double(sigma));
        return true;
    }
};

ceres::CostFunction *make_sphere_cost(const cn_adjust_observation &o, const double *begin)
{
    return new ceres::AutoDiffCostFunction<sphere_reprojection, 2, 2, 6, 3>(
        new sphere_reprojection{ begin, o.x_px, o.y_px, o.sigma_px });
}

template <int Lens> ceres::CostFunction *make_cost(const cn_adjust_observation &o, const double *begin)
{
    return new ceres::AutoDiffCostFunction<reprojection<Lens>, 2, lens<Lens>::n, 6, 3>(
        new reprojection<Lens>{ begin, o.x_px, o.y_px, o.sigma_px });
}

struct lens_entry {
    int n_params;
    ceres::CostFunction *(*cost)(const cn_adjust_observation &, const double *);
};
constexpr size_t kSphere = 6;
const std::array<lens_entry, 7> kLenses = { { { lens<0>::n, make_cost<0> },
                                              { lens<1>::n, make_cost<1> },
                                              { lens<2>::n, make_cost<2> },
                                              { lens<3>::n, make_cost<3> },
                                              { lens<4>::n, make_cost<4> },
                                              { lens<5>::n, make_cost<5> },
                                              { 2, make_sphere_cost } } };

// The lens's place in the list; the list's length where there is none.
size_t lens_of(int id)
{
    return id == CN_ADJUST_SPHERE ? kSphere : id >= 0 && id < int(kSphere) ? static_cast<size_t>(id) : kLenses.size();
}

// Three numbers at `offset` of a block, against where they should be.
struct place_prior {
    int offset;
    std::array<double, 3> place, weight; // weight: 1 / sigma, 0 without a prior
    template <typename T> bool operator()(const T *block, T *residual) const
    {
        for (int i = 0; i < 3; i++)
            residual[i] = (block[offset + i] - place[static_cast<size_t>(i)]) * weight[static_cast<size_t>(i)];
        return true;
    }
};

bool has_prior(const double sigma[3])
{
    return sigma[0] > 0 || sigma[1] > 0 || sigma[2] > 0;
}

place_prior make_prior(int offset, const double place[3], const double sigma[3])
{
    place_prior prior = { offset, {}, {} };
    for (size_t i = 0; i < 3; i++) {
        prior.place[i] = sigma[i] > 0 ? place[i] : 0;
        prior.weight[i] = sigma[i] > 0 ? 1 / sigma[i] : 0;
    }
    return prior;
}

// ---- Checks ----

bool finite(const double *values, int n)
{
    return std::all_of(values, values + n, [](double x) { return std::isfinite(x); });
}

bool good_prior(const double place[3], const double sigma[3])
{
    for (int i = 0; i < 3; i++)
        if (!(sigma[i] >= 0) || (sigma[i] > 0 && !std::isfinite(place[i]))) return false;
    return true;
}

cn_status check_blocks(const cn_adjust_problem *p)
{
    for (uint32_t i = 0; i < p->n_cameras; i++) {
        const cn_adjust_camera &c = p->cameras[i];
        const size_t kind = lens_of(c.lens);
        if (kind == kLenses.size() || !finite(c.params, kLenses[kind].n_params))
            return cn_fail(CN_ERR_DATA, "adjustment: camera %u has no lens that can be adjusted", i);
    }
    for (uint32_t i = 0; i < p->n_poses; i++) {
        const cn_adjust_pose &pose = p->poses[i];
        if (pose.camera >= p->n_cameras || !finite(pose.rotation, 9) || !finite(pose.translation, 3) ||
            !good_prior(pose.place, pose.place_sigma))
            return cn_fail(CN_ERR_DATA, "adjustment: pose %u is not finite, or names no camera", i);
    }
    for (uint32_t i = 0; i < p->n_points; i++)
        if (!finite(p->points[i].xyz, 3) || !good_prior(p->points[i].place, p->points[i].place_sigma))
            return cn_fail(CN_ERR_DATA, "adjustment: point %u is not finite", i);
    return CN_OK;
}

cn_status check(const cn_adjust_problem *p, const cn_adjust_options *options)
{
    if (!p->n_poses) return cn_fail(CN_ERR_DATA, "adjustment: there are no poses");
    CN_TRY(check_blocks(p));
    for (uint64_t i = 0; i < p->n_observations; i++) {
        const cn_adjust_observation &o = p->observations[i];
        if (o.pose >= p->n_poses || o.point >= p->n_points || !std::isfinite(o.x_px) || !std::isfinite(o.y_px) ||
            !(o.sigma_px > 0))
            return cn_fail(CN_ERR_DATA, "adjustment: observation %llu is not finite, or names no pose or point",
                           static_cast<unsigned long long>(i));
    }
    const size_t wanted = cn_ceres_bytes(p);
    if (options->max_bytes && wanted > options->max_bytes)
        return cn_fail(CN_ERR_NOMEM,
                       "adjustment: %llu observations of %u photos need about %.1f GB, but %.1f GB are allowed; give "
                       "fewer observations or more memory",
                       static_cast<unsigned long long>(p->n_observations), p->n_poses, double(wanted) / 1e9,
                       double(options->max_bytes) / 1e9);
    return CN_OK;
}

// ---- The problem ----

struct work {
    const cn_adjust_problem *given;
    std::vector<pose_state> poses;
    std::vector<std::array<double, 8>> cameras;
    std::vector<std::array<double, 3>> points;
    std::vector<bool> pose_used, camera_used, point_used;
    std::unique_ptr<ceres::LossFunction> loss, place_loss, point_loss;
    ceres::Problem problem;
    uint64_t n_behind = 0;
    explicit work(const cn_adjust_problem *p, const ceres::Problem::Options &o) : given(p), problem(o) {}
};

void copy_in(work &w)
{
    const cn_adjust_problem *p = w.given;
    w.poses.resize(p->n_poses);
    w.cameras.resize(p->n_cameras);
    w.points.resize(p->n_points);
    w.pose_used.resize(p->n_poses);
    w.camera_used.resize(p->n_cameras);
    w.point_used.resize(p->n_points);
    for (uint32_t i = 0; i < p->n_poses; i++) {
        const cn_adjust_pose &pose = p->poses[i];
        pose_state &state = w.poses[i];
        state = { pose.rotation, {} };
        for (int k = 0; k < 3; k++)
            for (int j = 0; j < 3; j++)
                state.values[3 + k] -= pose.rotation[3 * j + k] * pose.translation[j];
    }
    for (uint32_t i = 0; i < p->n_cameras; i++)
        std::copy_n(p->cameras[i].params, 8, w.cameras[i].begin());
    for (uint32_t i = 0; i < p->n_points; i++)
        std::copy_n(p->points[i].xyz, 3, w.points[i].begin());
}

void add_observations(work &w)
{
    const cn_adjust_problem *p = w.given;
    for (uint64_t i = 0; i < p->n_observations; i++) {
        const cn_adjust_observation &o = p->observations[i];
        pose_state &pose = w.poses[o.pose];
        const uint32_t camera = p->poses[o.pose].camera;
        const size_t kind = lens_of(p->cameras[camera].lens);
        double cam[3];
        to_camera(pose.begin, pose.values, w.points[o.point].data(), cam);
        if (!(cam[2] > 0) && kind < 5) {
            w.n_behind++;
            continue;
        }
        w.problem.AddResidualBlock(kLenses[kind].cost(o, pose.begin), w.loss.get(), w.cameras[camera].data(),
                                   pose.values, w.points[o.point].data());
        w.pose_used[o.pose] = w.camera_used[camera] = w.point_used[o.point] = true;
    }
}

void add_priors(work &w)
{
    const cn_adjust_problem *p = w.given;
    for (uint32_t i = 0; i < p->n_poses; i++) {
        const cn_adjust_pose &pose = p->poses[i];
        if (pose.fixed || !has_prior(pose.place_sigma)) continue;
        auto *prior = new place_prior(make_prior(3, pose.place, pose.place_sigma));
        w.problem.AddResidualBlock(new ceres::AutoDiffCostFunction<place_prior, 3, 6>(prior), w.place_loss.get(),
                                   w.poses[i].values);
        w.pose_used[i] = true;
    }
    for (uint32_t i = 0; i < p->n_points; i++) {
        const cn_adjust_point &point = p->points[i];
        // A point that no photo shows has nothing to say about the poses.
        if (point.fixed || !w.point_used[i] || !has_prior(point.place_sigma)) continue;
        auto *prior = new place_prior(make_prior(0, point.place, point.place_sigma));
        w.problem.AddResidualBlock(new ceres::AutoDiffCostFunction<place_prior, 3, 3>(prior), w.point_loss.get(),
                                   w.points[i].data());
    }
}

// A parameter of a lens is known before, to some degree.
void add_lens_priors(work &w)
{
    const cn_adjust_problem *p = w.given;
    for (uint32_t i = 0; i < p->n_cameras; i++) {
        const cn_adjust_camera &camera = p->cameras[i];
        const int n = kLenses[lens_of(camera.lens)].n_params;
        ceres::Matrix weights = ceres::Matrix::Zero(n, n);
        for (int k = 0; k < n; k++)
            if (camera.sigma[k] > 0 && !(camera.fixed >> k & 1u)) weights(k, k) = 1 / camera.sigma[k];
        if (!w.camera_used[i] || weights.isZero()) continue;
        w.problem.AddResidualBlock(new ceres::NormalPrior(weights, Eigen::Map<const Eigen::VectorXd>(camera.params, n)),
                                   nullptr, w.cameras[i].data());
    }
}

void fix_parameters(work &w)
{
    const cn_adjust_problem *p = w.given;
    for (uint32_t i = 0; i < p->n_poses; i++)
        if (w.pose_used[i] && p->poses[i].fixed) w.problem.SetParameterBlockConstant(w.poses[i].values);
    for (uint32_t i = 0; i < p->n_points; i++)
        if (w.point_used[i] && p->points[i].fixed) w.problem.SetParameterBlockConstant(w.points[i].data());
    for (uint32_t i = 0; i < p->n_cameras; i++) {
        const int n = kLenses[lens_of(p->cameras[i].lens)].n_params;
        std::vector<int> still;
        for (int k = 0; k < n; k++)
            if (p->cameras[i].fixed >> k & 1u) still.push_back(k);
        if (!w.camera_used[i] || still.empty()) continue;
        if (static_cast<int>(still.size()) == n)
            w.problem.SetParameterBlockConstant(w.cameras[i].data());
        else
            w.problem.SetManifold(w.cameras[i].data(), new ceres::SubsetManifold(n, still));
    }
}

// Points are eliminated first; the rest is solved in a way that its size allows.
ceres::Solver::Options solver_options(work &w, const cn_adjust_options *options)
{
    // Photos of a city see far: the reduced matrix of a thousand is nearly full, and conjugate gradients take a fifth
    // of the time of factoring it (tests/bench/pose_scale.c).
    constexpr uint32_t few = 60, many = 500;
    ceres::Solver::Options o;
    const uint32_t n = w.given->n_poses;
    o.linear_solver_type = n <= few ? ceres::DENSE_SCHUR : n <= many ? ceres::SPARSE_SCHUR : ceres::ITERATIVE_SCHUR;
    o.preconditioner_type = ceres::SCHUR_JACOBI;
    /* Within a group Ceres orders blocks by their addresses. Blocks of a kind lie in one array; two kinds in one group
     * would be ordered by where the heap has their arrays, and the last digits would vary from run to run. */
    o.linear_solver_ordering = std::make_shared<ceres::ParameterBlockOrdering>();
    for (uint32_t i = 0; i < w.given->n_points; i++)
        if (w.point_used[i]) o.linear_solver_ordering->AddElementToGroup(w.points[i].data(), 0);
    for (uint32_t i = 0; i < n; i++)
        if (w.pose_used[i]) o.linear_solver_ordering->AddElementToGroup(w.poses[i].values, 1);
    for (uint32_t i = 0; i < w.given->n_cameras; i++)
        if (w.camera_used[i]) o.linear_solver_ordering->AddElementToGroup(w.cameras[i].data(), 2);
    o.max_num_iterations = static_cast<int>(options->max_iterations);
    o.num_threads = options->n_threads ? static_cast<int>(options->n_threads) : 1;
    o.max_linear_solver_iterations = 200;
    o.function_tolerance = 1e-7;
    o.parameter_tolerance = 1e-9;
    o.logging_type = ceres::SILENT;
    return o;
}

void copy_out(const work &w)
{
    const cn_adjust_problem *p = w.given;
    for (uint32_t i = 0; i < p->n_poses; i++) {
        if (!w.pose_used[i] || p->poses[i].fixed) continue;
        cn_adjust_pose &pose = p->poses[i];
        const double *values = w.poses[i].values;
        double turn[9], was[9];
        std::copy_n(pose.rotation, 9, was);
        ceres::AngleAxisToRotationMatrix(values, ceres::RowMajorAdapter3x3(turn));
        for (int r = 0; r < 3; r++) {
            pose.translation[r] = 0;
            for (int c = 0; c < 3; c++) {
                double &x = pose.rotation[3 * r + c];
                x = turn[3 * r] * was[c] + turn[3 * r + 1] * was[3 + c] + turn[3 * r + 2] * was[6 + c];
                pose.translation[r] -= x * values[3 + c];
            }
        }
    }
    for (uint32_t i = 0; i < p->n_cameras; i++)
        std::copy_n(w.cameras[i].begin(), 8, p->cameras[i].params);
    for (uint32_t i = 0; i < p->n_points; i++)
        std::copy_n(w.points[i].begin(), 3, p->points[i].xyz);
}

bool all_finite(const work &w)
{
    return std::all_of(w.poses.begin(), w.poses.end(), [](const pose_state &s) { return finite(s.values, 6); }) &&
           std::all_of(w.cameras.begin(), w.cameras.end(), [](const auto &c) { return finite(c.data(), 8); }) &&
           std::all_of(w.points.begin(), w.points.end(), [](const auto &p) { return finite(p.data(), 3); });
}

cn_status solve(const cn_context *ctx, work &w, const cn_adjust_options *options, cn_adjust_result *result)
{
    cn_watcher watch(ctx, options->stage, options->max_iterations);
    ceres::Solver::Options how = solver_options(w, options);
    ceres::Solver::Summary summary;
    how.callbacks.push_back(&watch);
    ceres::Solve(how, &w.problem, &summary);
    if (watch.stopped) return cn_fail(CN_ERR_INTERRUPTED, "stopped while adjusting; run the same command to resume");
    if (!summary.IsSolutionUsable() || !all_finite(w))
        return cn_fail(CN_ERR_DATA, "adjustment of %u photos and %u points: %s", w.given->n_poses, w.given->n_points,
                       summary.message.c_str());
    *result = { static_cast<uint32_t>(summary.iterations.size()), summary.termination_type == ceres::CONVERGENCE,
                summary.final_cost, summary.initial_cost, w.n_behind };
    copy_out(w);
    return CN_OK;
}

std::unique_ptr<ceres::LossFunction> make_loss(double sigmas)
{
    return std::unique_ptr<ceres::LossFunction>(sigmas > 0 ? new ceres::CauchyLoss(sigmas) : nullptr);
}

cn_status adjust(const cn_context *ctx, const cn_adjust_problem *problem, const cn_adjust_options *options,
                 cn_adjust_result *result)
{
    ceres::Problem::Options ownership;
    ownership.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
    work w(problem, ownership);
    w.loss = make_loss(options->loss_sigmas);
    w.place_loss = make_loss(options->place_sigmas);
    w.point_loss = make_loss(options->point_sigmas);
    copy_in(w);
    add_observations(w);
    add_priors(w);
    add_lens_priors(w);
    fix_parameters(w);
    return solve(ctx, w, options, result);
}

} // namespace

extern "C" cn_adjust_options cn_adjust_options_default(void)
{
    return { 100, 1, 0, 2, 3, 3, nullptr };
}

extern "C" size_t cn_ceres_bytes(const cn_adjust_problem *problem)
{
    // Measured: a residual with its Jacobian, and a block of parameters with its bookkeeping.
    constexpr size_t an_observation = 1000, a_block = 400;
    const size_t n_blocks = size_t(problem->n_poses) + problem->n_points + problem->n_cameras;
    return an_observation * static_cast<size_t>(problem->n_observations) + a_block * n_blocks;
}

extern "C" cn_status cn_ceres_adjust(const cn_context *ctx, const cn_adjust_problem *problem,
                                     const cn_adjust_options *options, cn_adjust_result *result)
{
    *result = {};
    try {
        FLAGS_minloglevel = google::GLOG_FATAL;
        CN_TRY(check(problem, options));
        return adjust(ctx, problem, options, result);
    } catch (const std::bad_alloc &) {
        return cn_fail(CN_ERR_NOMEM, "out of memory adjusting %u photos", problem->n_poses);
    } catch (const std::exception &e) {
        return cn_fail(CN_ERR_INTERNAL, "adjustment: %s", e.what());
    } catch (...) {
        return cn_fail(CN_ERR_INTERNAL, "adjustment: unknown exception from Ceres");
    }
}
