#include <ceres/problem.h>
#include <ceres/solver.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <numeric>
#include <optional>

#include "geometry/skew.h"
#include "motion/motion_cost.h"
#include "point_line_odometry/motion.h"

namespace point_line_odometry {
namespace {

// Relative change of the cost at which the solver stops: before outliers are removed, and after.
constexpr double kCoarseTolerance = 1e-5;
constexpr double kFineTolerance = 1e-6;

// The weights of matches are taken to be true until the residuals outnumber so many that are.
constexpr double kWeightsTrusted = 20.0;

// Matches so near to a prediction are where it puts them.
constexpr double kPredictedPx = 2.0;

/// Normal matrix by (rotation, translation) of the solver's perturbation, and what the residuals
/// amount to.
struct Statistics {
  Matrix6d information = Matrix6d::Zero();
  double pulls = 0.0;        // squares of the residuals times their Huber weights
  double weights = 0.0;      // these weights, for each row
  double stiffnesses = 0.0;  // how much a pull changes with its residual, for each row
  double squares_px = 0.0;
  int rows = 0;
  ResidualHistogram points;
  ResidualHistogram lines;
};

/// The least-squares problem of one frame: its matches and their weights, and its solution.
template <ResidualImages kImages>
class MotionProblem {
 public:
  MotionProblem(const Correspondences& correspondences, const StereoCamera& camera,
                const MotionParameters& parameters)
      : parameters_(parameters),
        points_(correspondences.points, camera),
        lines_(correspondences.lines, camera) {}

  int numPoints() const { return points_.count(); }
  int numLines() const { return lines_.count(); }
  const std::vector<bool>& pointActive() const { return points_.active(); }
  const std::vector<bool>& lineActive() const { return lines_.active(); }

  void linearizeWeights(const Eigen::Isometry3d& T_curr_prev) {
    points_.linearizeWeights(T_curr_prev, parameters_.use_triangulation_covariance);
    lines_.linearizeWeights(T_curr_prev, parameters_.use_triangulation_covariance);
  }

  void selectInliers(const Eigen::Isometry3d& T_curr_prev) {
    points_.selectInliers(T_curr_prev, parameters_.outlier_threshold);
    lines_.selectInliers(T_curr_prev, parameters_.outlier_threshold);
  }

  /// Takes all that have a weight.
  void selectAll() {
    points_.selectAll();
    lines_.selectAll();
  }

  /// Takes the matches that are seen within a distance from where a motion puts them.
  void selectNear(const Eigen::Isometry3d& T_curr_prev, double max_distance_px) {
    points_.selectNear(T_curr_prev, max_distance_px);
    lines_.selectNear(T_curr_prev, max_distance_px);
  }

  struct Solution {
    bool usable = false;
    Eigen::Isometry3d T_curr_prev = Eigen::Isometry3d::Identity();
    int iterations = 0;
  };

  struct SolveOptions {
    bool hold_rotation = false;
    double function_tolerance =
        kFineTolerance;  // relative change of the cost at which the solver stops
  };

  /// Levenberg-Marquardt from a start.
  Solution solve(const Eigen::Isometry3d& T_curr_prev, const SolveOptions& solve_options) const {
    MotionVector motion = MotionVector::from(T_curr_prev);
    MotionCost<kImages> cost(points_, lines_, parameters_.huber_delta);
    ceres::Problem::Options problem_options;
    problem_options.cost_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
    ceres::Problem problem(problem_options);
    problem.AddResidualBlock(&cost, nullptr, motion.rotation.data(), motion.translation.data());
    NearStart near_rotation(motion.rotation);
    NearStart near_translation(motion.translation);
    problem.AddResidualBlock(&near_rotation, nullptr, motion.rotation.data());
    problem.AddResidualBlock(&near_translation, nullptr, motion.translation.data());
    if (solve_options.hold_rotation) problem.SetParameterBlockConstant(motion.rotation.data());
    ceres::Solver::Options options;
    options.linear_solver_type = ceres::DENSE_NORMAL_CHOLESKY;
    options.max_num_iterations = parameters_.max_iterations;
    options.function_tolerance = solve_options.function_tolerance;
    options.num_threads = 1;
    options.logging_type = ceres::SILENT;
    ceres::Solver::Summary summary;
    ceres::Solve(options, &problem, &summary);
    Solution solution;
    solution.T_curr_prev = motion.toIsometry();
    solution.usable = summary.IsSolutionUsable() && solution.T_curr_prev.matrix().allFinite();
    solution.iterations = static_cast<int>(summary.iterations.size()) - 1;
    return solution;
  }

  Statistics statistics(const Eigen::Isometry3d& T_curr_prev) const {
    Statistics statistics;
    const auto add = [&](const auto& residual, const auto& weight, ResidualHistogram* histogram) {
      const auto whitened = (weight * residual.value).eval();
      const double norm = whitened.norm();
      const double huber_weight =
          norm > parameters_.huber_delta ? parameters_.huber_delta / norm : 1.0;
      const auto J = (weight * residual.byMotion()).eval();
      statistics.information += huber_weight * J.transpose() * J;
      const auto rows = static_cast<int>(residual.value.size());
      statistics.pulls += huber_weight * huber_weight * norm * norm;
      statistics.weights += huber_weight * rows;
      statistics.stiffnesses += huber_weight * (huber_weight < 1.0 ? rows - 1 : rows);
      statistics.squares_px += residual.value.squaredNorm();
      statistics.rows += rows;
      for (Eigen::Index i = 0; i < whitened.size(); ++i) histogram->add(whitened[i]);
    };
    points_.forEachActive(T_curr_prev, [&](const auto& residual, const auto& weight) {
      add(residual, weight, &statistics.points);
    });
    lines_.forEachActive(T_curr_prev, [&](const auto& residual, const auto& weight) {
      add(residual, weight, &statistics.lines);
    });
    return statistics;
  }

 private:
  const MotionParameters& parameters_;
  WeightedMatches<PointResidual<kImages>> points_;
  WeightedMatches<LineResidual<kImages>> lines_;
};

/// How many times the inverse of the normal matrix the covariance is: what the residuals show of
/// how far the weights are true, for estimates with Huber's weights (Huber, Robust Statistics,
/// 1981, section 7.6; a kernel of a norm pulls along its residual only).
double covarianceScale(const Statistics& statistics) {
  const double freedoms = std::max(statistics.rows - 6, 0);
  if (!(statistics.stiffnesses > 0.0) || !(freedoms > 0.0)) return 1.0;
  const double shown = statistics.pulls * statistics.weights * statistics.rows /
                       (statistics.stiffnesses * statistics.stiffnesses);
  return (shown + kWeightsTrusted) / (freedoms + kWeightsTrusted);
}

/// From the normal matrix of the solver's perturbation of T_curr_prev to the covariance of
/// T_prev_curr in ROS' order.
Matrix6d motionCovariance(const Statistics& statistics, const Eigen::Isometry3d& T_curr_prev) {
  const Eigen::SelfAdjointEigenSolver<Matrix6d> eigen(statistics.information);
  // Directions that nothing measures get a huge but finite variance.
  const double floor = std::max(1e-12 * eigen.eigenvalues().maxCoeff(), 1e-12);
  const Matrix6d inverse = eigen.eigenvectors() *
                           eigen.eigenvalues().cwiseMax(floor).cwiseInverse().asDiagonal() *
                           eigen.eigenvectors().transpose();
  const double scale = covarianceScale(statistics);

  // R_prev_curr = R^T and t_prev_curr = -R^T t under (exp(rotation) R, t + translation).
  const Eigen::Matrix3d R_t = T_curr_prev.linear().transpose();
  const Eigen::Vector3d& t = T_curr_prev.translation();
  Matrix6d J = Matrix6d::Zero();
  J.block<3, 3>(0, 0) = -R_t * skew(t);
  J.block<3, 3>(0, 3) = -R_t;
  J.block<3, 3>(3, 0) = -R_t;
  const Matrix6d covariance = scale * J * inverse * J.transpose();
  return 0.5 * (covariance + covariance.transpose());
}

template <ResidualImages kImages>
MotionEstimate failed(MotionStatus status, const MotionProblem<kImages>& problem, int iterations) {
  MotionEstimate estimate;
  estimate.status = status;
  estimate.point_inliers.assign(problem.pointActive().size(), false);
  estimate.line_inliers.assign(problem.lineActive().size(), false);
  estimate.iterations = iterations;
  return estimate;
}

template <ResidualImages kImages>
MotionEstimate finished(const MotionProblem<kImages>& problem, const Eigen::Isometry3d& T_curr_prev,
                        int iterations) {
  const Statistics statistics = problem.statistics(T_curr_prev);
  MotionEstimate estimate;
  estimate.status = MotionStatus::kOk;
  estimate.T_curr_prev = T_curr_prev;
  estimate.covariance = motionCovariance(statistics, T_curr_prev);
  estimate.point_inliers = problem.pointActive();
  estimate.line_inliers = problem.lineActive();
  estimate.num_point_inliers = problem.numPoints();
  estimate.num_line_inliers = problem.numLines();
  estimate.iterations = iterations;
  estimate.rms_px = std::sqrt(statistics.squares_px / std::max(statistics.rows, 1));
  estimate.point_residuals = statistics.points;
  estimate.line_residuals = statistics.lines;
  return estimate;
}

/// Solves with the matches that take part, removes outliers, and solves again. Where outliers are
/// not removed, they are only told from the others.
template <ResidualImages kImages>
MotionEstimate solveTwice(const Eigen::Isometry3d& start, const MotionParameters& parameters,
                          MotionProblem<kImages>* problem) {
  const int matches = problem->numPoints() + problem->numLines();
  if (matches < parameters.min_matches) return failed(MotionStatus::kTooFewMatches, *problem, 0);
  const bool again = parameters.remove_outliers;
  const auto first = problem->solve(start, {false, again ? kCoarseTolerance : kFineTolerance});
  if (!first.usable) return failed(MotionStatus::kSolverFailed, *problem, first.iterations);
  problem->linearizeWeights(first.T_curr_prev);
  problem->selectInliers(first.T_curr_prev);
  const int inliers = problem->numPoints() + problem->numLines();
  if (inliers < parameters.min_inliers || inliers < parameters.min_inlier_ratio * matches) {
    return failed(MotionStatus::kTooFewInliers, *problem, first.iterations);
  }
  if (!again) return finished(*problem, first.T_curr_prev, first.iterations);
  const auto second = problem->solve(first.T_curr_prev, {false, kFineTolerance});
  const int iterations = first.iterations + second.iterations;
  if (!second.usable) return failed(MotionStatus::kSolverFailed, *problem, iterations);
  return finished(*problem, second.T_curr_prev, iterations);
}

/// The estimator for the images that give residuals. \param max_distance_px if given, only matches
/// that the start explains so well take part.
template <ResidualImages kImages>
MotionEstimate estimate(const Correspondences& correspondences, const StereoCamera& camera,
                        const Eigen::Isometry3d& start, const MotionParameters& parameters,
                        std::optional<double> max_distance_px) {
  MotionProblem<kImages> problem(correspondences, camera, parameters);
  problem.linearizeWeights(start);
  if (max_distance_px) problem.selectNear(start, *max_distance_px);
  return solveTwice(start, parameters, &problem);
}

/// Solves for the translation at a rotation that is held; `direct` if that fails.
template <ResidualImages kImages>
MotionEstimate estimateTranslation(const MotionEstimate& direct, const Eigen::Isometry3d& start,
                                   const Correspondences& correspondences,
                                   const StereoCamera& camera, const MotionParameters& parameters) {
  MotionProblem<kImages> problem(correspondences, camera, parameters);
  problem.linearizeWeights(start);
  problem.selectInliers(start);
  const int inliers = problem.numPoints() + problem.numLines();
  if (inliers < parameters.min_inliers) return direct;
  if (!parameters.remove_outliers) problem.selectAll();
  const auto solution = problem.solve(start, {true, kFineTolerance});
  if (!solution.usable) return direct;
  if (!parameters.remove_outliers) problem.selectInliers(solution.T_curr_prev);
  return finished(problem, solution.T_curr_prev, direct.iterations + solution.iterations);
}

bool usesBothImages(const MotionParameters& parameters) {
  return parameters.residual_images == "both";
}

}  // namespace

const char* toString(MotionStatus status) {
  switch (status) {
    case MotionStatus::kOk:
      return "ok";
    case MotionStatus::kTooFewMatches:
      return "too_few_matches";
    case MotionStatus::kSolverFailed:
      return "solver_failed";
    case MotionStatus::kTooFewInliers:
      return "too_few_inliers";
  }
  return "unknown";
}

void ResidualHistogram::add(double value) {
  const double bin = std::floor(value / kBinWidth) + kMiddle;
  ++counts[static_cast<std::size_t>(std::clamp(bin, 0.0, kBins - 1.0))];
  squares += value * value;
}

void ResidualHistogram::add(const ResidualHistogram& other) {
  for (std::size_t i = 0; i < counts.size(); ++i) counts[i] += other.counts[i];
  squares += other.squares;
}

std::int64_t ResidualHistogram::size() const {
  return std::accumulate(counts.begin(), counts.end(), std::int64_t{0});
}

double ResidualHistogram::variance() const {
  return squares / static_cast<double>(std::max(size(), std::int64_t{1}));
}

MotionEstimate estimateMotion(const Correspondences& correspondences, const StereoCamera& camera,
                              const Eigen::Isometry3d& T_curr_prev_initial,
                              const MotionParameters& parameters) {
  const auto estimator = usesBothImages(parameters) ? estimate<ResidualImages::kBoth>
                                                    : estimate<ResidualImages::kLeft>;
  return estimator(correspondences, camera, T_curr_prev_initial, parameters, std::nullopt);
}

MotionEstimate estimateMotionNearPrediction(const Correspondences& correspondences,
                                            const StereoCamera& camera,
                                            const Eigen::Isometry3d& T_curr_prev_predicted,
                                            const MotionParameters& parameters) {
  const auto estimator = usesBothImages(parameters) ? estimate<ResidualImages::kBoth>
                                                    : estimate<ResidualImages::kLeft>;
  return estimator(correspondences, camera, T_curr_prev_predicted, parameters, kPredictedPx);
}

MotionEstimate fuseRotation(const MotionEstimate& direct, const Eigen::Isometry3d& T_curr_prev2,
                            const Eigen::Isometry3d& T_prev_prev2,
                            const Correspondences& correspondences, const StereoCamera& camera,
                            const MotionParameters& parameters) {
  const Eigen::Quaterniond by_two_frames(T_curr_prev2.linear() * T_prev_prev2.linear().transpose());
  const Eigen::Quaterniond by_one(direct.T_curr_prev.linear());
  Eigen::Isometry3d fused = direct.T_curr_prev;
  fused.linear() = by_one.slerp(0.5, by_two_frames).normalized().toRotationMatrix();
  const auto estimator = usesBothImages(parameters) ? estimateTranslation<ResidualImages::kBoth>
                                                    : estimateTranslation<ResidualImages::kLeft>;
  return estimator(direct, fused, correspondences, camera, parameters);
}

}  // namespace point_line_odometry
