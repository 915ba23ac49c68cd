#pragma once

#include <ceres/problem.h>
#include <ceres/solver.h>

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <cstddef>
#include <optional>
#include <utility>
#include <vector>

#include "common/thread_pool.h"
#include "motion/correspondence.h"
#include "motion/huber_loss.h"
#include "motion/motion_cost.h"
#include "motion/motion_covariance.h"
#include "motion/patch_overlap.h"
#include "motion/prior_factor.h"
#include "motion/solution_separation.h"
#include "motion/weighted_matches.h"
#include "point_line_odometry/parameters.h"
#include "point_line_odometry/stereo_camera.h"
#include "point_line_odometry/types.h"

namespace point_line_odometry {

// Iterations of the solver at most: with 100 of them all figures of the test sequences are equal.
constexpr int kMaxSolverIterations = 20;

/// The least-squares problem of one frame: its matches, their square-root information, and the
/// solver.
template <ResidualImages kImages>
class MotionProblem {
 public:
  MotionProblem(const Correspondences& correspondences, const StereoCamera& camera,
                const MotionParameters& parameters, ThreadPool* threads,
                const PriorFactor* prior = nullptr)
      : parameters_(parameters),
        camera_(camera),
        threads_(threads),
        prior_(prior),
        points_(correspondences.points, camera),
        lines_(correspondences.lines, camera) {}

  int numPoints() const { return points_.count(); }
  int numLines() const { return lines_.count(); }
  int numNear() const { return points_.countNear() + lines_.countNear(); }
  double expectedRightNear(const Eigen::Isometry3d& T_curr_prev) const {
    return points_.expectedRightNear(T_curr_prev, parameters_.outlier_threshold) +
           lines_.expectedRightNear(T_curr_prev, parameters_.outlier_threshold);
  }
  const std::vector<bool>& pointActive() const { return points_.active(); }
  const std::vector<bool>& lineActive() const { return lines_.active(); }

  /// Square-root information of all residuals at a motion.
  void linearizeInformation(const Eigen::Isometry3d& T_curr_prev) {
    points_.linearizeInformation(T_curr_prev, parameters_.use_triangulation_covariance);
    lines_.linearizeInformation(T_curr_prev, parameters_.use_triangulation_covariance);
  }

  /// The same at an estimate: landmarks of points are refined by both frames. (Of lines no bias was
  /// measurable.)
  void relinearize(const Eigen::Isometry3d& T_curr_prev) {
    if (parameters_.use_triangulation_covariance) points_.refineLandmarks(T_curr_prev);
    linearizeInformation(T_curr_prev);
  }

  void selectInliers(const Eigen::Isometry3d& T_curr_prev) {
    points_.selectInliers(T_curr_prev, parameters_.outlier_threshold);
    lines_.selectInliers(T_curr_prev, parameters_.outlier_threshold);
  }

  /// The translation by which far points are shifted: that of the last linearization.
  const Eigen::Vector3d& translationOfFar() const { return points_.translationOfFar(); }

  /// Activates all matches that have a square-root information.
  void selectAll() {
    points_.selectAll();
    lines_.selectAll();
  }

  /// Activates the matches with reprojection errors below a limit at a motion.
  void selectNear(const Eigen::Isometry3d& T_curr_prev, double max_distance_px) {
    points_.selectNear(T_curr_prev, max_distance_px);
    lines_.selectNear(T_curr_prev, max_distance_px);
  }

  /// Activates as pointActive() and lineActive() were before.
  void select(const std::vector<bool>& points, const std::vector<bool>& lines) {
    points_.select(points);
    lines_.select(lines);
  }

  /// Drops the active matches with a leverage above a limit; see WeightedMatches. Returns their
  /// number.
  int dropLeverage(const Eigen::Isometry3d& T_curr_prev, double limit) {
    Matrix6d information = Matrix6d::Zero();
    const auto add = [&](const auto& residual, const auto& sqrt_information, const auto&) {
      const auto J = (sqrt_information * residual.jacobianByMotion()).eval();
      information += J.transpose() * J;
    };
    points_.forEachActive(T_curr_prev, add);
    lines_.forEachActive(T_curr_prev, add);
    const Eigen::LLT<Matrix6d> root(information);
    if (root.info() != Eigen::Success) return 0;  // an axis is not constrained
    const Matrix6d covariance = root.solve(Matrix6d::Identity());
    return points_.dropLeverage(T_curr_prev, covariance, limit) +
           lines_.dropLeverage(T_curr_prev, covariance, limit);
  }

  /// Drops the active matches of the part of the image that moves the motion most, if there is one;
  /// see SolutionSeparation. Returns their number.
  int dropSeparated(const Eigen::Isometry3d& T_curr_prev) {
    SolutionSeparation separation(camera_);
    if (prior_ != nullptr) {
      const PriorFactor::Linearization prior = prior_->linearize(T_curr_prev);
      separation.addPrior(prior.loss.weight * prior.jacobian.transpose() * prior.jacobian);
    }
    const auto add = [&](const auto& residual, const auto& sqrt_information, const auto& match) {
      const auto r = (sqrt_information * residual.value).eval();
      const auto J = (sqrt_information * residual.jacobianByMotion()).eval();
      const double weight = HuberLoss(r.squaredNorm(), parameters_.huber_delta).weight;
      separation.add(pixelOf(match), weight * J.transpose() * J, weight * J.transpose() * r);
    };
    points_.forEachActive(T_curr_prev, add);
    lines_.forEachActive(T_curr_prev, add);
    const std::optional<Eigen::AlignedBox2d> part = separation.mostSeparated();
    return part ? points_.dropIn(*part) + lines_.dropIn(*part) : 0;
  }

  /// How well all matches agree with a motion: see WeightedMatches.
  double limitedCost(const Eigen::Isometry3d& T_curr_prev, double limit) const {
    return points_.limitedCost(T_curr_prev, limit, std::vector<double>(points_.size(), 1.0)) +
           lines_.limitedCost(T_curr_prev, limit, std::vector<double>(lines_.size(), 1.0));
  }

  /// The same, where points whose patches overlap count as the one piece of scene that they show:
  /// they are wrong together.
  double limitedCostOfScene(const Eigen::Isometry3d& T_curr_prev, double limit) const {
    std::vector<PatchArea> patches;
    for (const PointCorrespondence& point : points_.matches())
      patches.push_back({point.left_px, point.patch_px});
    std::vector<double> weights(patches.size(), 1.0);
    forEachOverlap(patches, [&](std::size_t i, std::size_t j, double overlap) {
      weights[i] += overlap;
      weights[j] += overlap;
    });
    for (double& weight : weights) weight = 1.0 / weight;
    return points_.limitedCost(T_curr_prev, limit, weights) +
           lines_.limitedCost(T_curr_prev, limit, std::vector<double>(lines_.size(), 1.0));
  }

  /// Drops the matches that constrain the translation.
  void dropNear() {
    points_.dropNear();
    lines_.dropNear();
  }

  struct SolveResult {
    bool usable = false;
    Eigen::Isometry3d T_curr_prev = Eigen::Isometry3d::Identity();
    int iterations = 0;
  };

  struct SolveOptions {
    bool fix_rotation = false;
    double function_tolerance;  // relative change of the cost at which the solver stops
  };

  /// Levenberg-Marquardt from an initial motion.
  SolveResult solve(const Eigen::Isometry3d& T_curr_prev, const SolveOptions& solve_options) const {
    MotionVector motion = MotionVector::from(T_curr_prev);
    const MotionCost<kImages> cost(points_, lines_, parameters_.huber_delta, threads_);
    ceres::Problem::Options problem_options;
    problem_options.cost_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
    ceres::Problem problem(problem_options);
    ReducedMotionCost reduced(cost, motion, prior_);
    problem.AddResidualBlock(&reduced, nullptr, motion.rotation.data(), motion.translation.data());
    if (solve_options.fix_rotation) problem.SetParameterBlockConstant(motion.rotation.data());
    ceres::Solver::Options options;
    options.linear_solver_type = ceres::DENSE_NORMAL_CHOLESKY;
    options.max_num_iterations = kMaxSolverIterations;
    options.function_tolerance = solve_options.function_tolerance;
    options.num_threads = 1;
    options.logging_type = ceres::SILENT;
    ceres::Solver::Summary summary;
    ceres::Solve(options, &problem, &summary);
    SolveResult result;
    result.T_curr_prev = motion.toIsometry();
    result.usable = summary.IsSolutionUsable() && result.T_curr_prev.matrix().allFinite();
    result.iterations = static_cast<int>(summary.iterations.size()) - 1;
    return result;
  }

  const PriorFactor* prior() const { return prior_; }
  const StereoCamera& camera() const { return camera_; }

  ResidualStatistics statistics(const Eigen::Isometry3d& T_curr_prev) const {
    ResidualStatistics statistics(camera_);
    const auto add = [&](const auto& residual, const auto& sqrt_information, const auto& match,
                         ResidualHistogram* histogram) {
      const auto whitened = (sqrt_information * residual.value).eval();
      const double norm = whitened.norm();
      const double huber_weight = HuberLoss(whitened.squaredNorm(), parameters_.huber_delta).weight;
      const auto J = (sqrt_information * residual.jacobianByMotion()).eval();
      statistics.information.add(pixelOf(match),
                                 {huber_weight * J.transpose() * J,
                                  huber_weight * shiftOfFar(residual, sqrt_information, match),
                                  huber_weight * byDisparity(residual, sqrt_information, match)});
      const auto rows = static_cast<int>(residual.value.size());
      statistics.squares_px += residual.value.squaredNorm();
      statistics.rows += rows;
      ++statistics.matches;
      for (Eigen::Index i = 0; i < whitened.size(); ++i) histogram->add(whitened[i]);
      if (!isFar(match)) {
        statistics.sum_psi2 += huber_weight * huber_weight * norm * norm;
        statistics.sum_weights += huber_weight * rows;
        statistics.sum_psi_derivative += huber_weight * (huber_weight < 1.0 ? rows - 1 : rows);
        statistics.weighted_rows += rows;
      }
      return (huber_weight * J).eval();
    };
    std::vector<PatchJacobian> patches;
    points_.forEachActive(
        T_curr_prev, [&](const auto& residual, const auto& sqrt_information, const auto& match) {
          const auto J = add(residual, sqrt_information, match, &statistics.points);
          if (match.patch_px > 0.0) patches.push_back({{match.left_px, match.patch_px}, J});
        });
    lines_.forEachActive(
        T_curr_prev, [&](const auto& residual, const auto& sqrt_information, const auto& match) {
          add(residual, sqrt_information, match, &statistics.lines);
        });
    statistics.information.addCorrelations(patches);
    return statistics;
  }

 private:
  /// Derivative of a far point's J^T r by the translation at which it is seen.
  template <typename SqrtInformation>
  static Matrix6d shiftOfFar(const PointResidual<kImages>& residual,
                             const SqrtInformation& sqrt_information,
                             const PointCorrespondence& point) {
    Matrix6d shift = Matrix6d::Zero();
    if (!point.far) return shift;
    const auto J = (sqrt_information * residual.jacobianByMotion()).eval();
    shift.rightCols<3>() = J.transpose() * (sqrt_information * residual.jacobianByTranslation());
    return shift;
  }
  template <typename SqrtInformation>
  static Matrix6d shiftOfFar(const LineResidual<kImages>&, const SqrtInformation&,
                             const LineCorrespondence&) {
    return Matrix6d::Zero();
  }

  /// Derivative of J^T r by an error that makes every disparity larger: points are triangulated
  /// nearer, and their right pixels in frame k lie further left.
  template <typename SqrtInformation>
  Vector6d byDisparity(const PointResidual<kImages>& residual,
                       const SqrtInformation& sqrt_information,
                       const PointCorrespondence& point) const {
    const bool in_front = point.p_prev.z() > camera_.baseline_m;  // landmarks may be behind
    if (!in_front || !parameters_.use_triangulation_covariance) return Vector6d::Zero();
    const double disparity_px = camera_.fx * camera_.baseline_m / point.p_prev.z();
    auto derivative = (residual.jacobianByLandmark() * (-point.p_prev / disparity_px)).eval();
    if constexpr (kImages == ResidualImages::kBoth) derivative(2) -= 1.0;
    const auto J = (sqrt_information * residual.jacobianByMotion()).eval();
    return J.transpose() * (sqrt_information * derivative);
  }
  template <typename SqrtInformation>
  static Vector6d byDisparity(const LineResidual<kImages>&, const SqrtInformation&,
                              const LineCorrespondence&) {
    return Vector6d::Zero();
  }

  const MotionParameters& parameters_;
  const StereoCamera& camera_;
  ThreadPool* threads_;
  const PriorFactor* prior_;
  WeightedMatches<PointResidual<kImages>> points_;
  WeightedMatches<LineResidual<kImages>> lines_;
};

}  // namespace point_line_odometry
