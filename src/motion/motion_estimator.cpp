#include <ceres/loss_function.h>
#include <ceres/problem.h>
#include <ceres/solver.h>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

#include "geometry/skew.h"
#include "motion/residuals.h"
#include "point_line_odometry/motion.h"

namespace point_line_odometry {
namespace {

ResidualImages residualImages(const MotionParameters& parameters) {
  return parameters.residual_images == "left" ? ResidualImages::kLeft : ResidualImages::kBoth;
}

/// Inverse square root of a residual's covariance: pixel noise, and the triangulation's carried
/// through the residual. Empty if residual or covariance are not finite.
template <typename Jacobian, typename Covariance>
Eigen::MatrixXd sqrtInformation(double sigma_px, const Jacobian& by_landmark,
                                const Covariance& covariance, bool use_covariance) {
  const int rows = static_cast<int>(by_landmark.rows());
  Eigen::MatrixXd total = sigma_px * sigma_px * Eigen::MatrixXd::Identity(rows, rows);
  if (use_covariance) total += by_landmark * covariance * by_landmark.transpose();
  const Eigen::LLT<Eigen::MatrixXd> cholesky(total);
  if (!total.allFinite() || cholesky.info() != Eigen::Success) return {};
  return cholesky.matrixL().solve(Eigen::MatrixXd::Identity(rows, rows));
}

/// The least-squares problem of one frame: which matches take part, their weights, and its
/// solution.
class MotionProblem {
 public:
  MotionProblem(const Correspondences& correspondences, const StereoCamera& camera,
                const MotionParameters& parameters)
      : correspondences_(correspondences),
        camera_(camera),
        parameters_(parameters),
        images_(residualImages(parameters)),
        point_active_(correspondences.points.size(), true),
        line_active_(correspondences.lines.size(), true) {}

  int numPoints() const { return countActive(point_active_); }
  int numLines() const { return countActive(line_active_); }
  const std::vector<bool>& pointActive() const { return point_active_; }
  const std::vector<bool>& lineActive() const { return line_active_; }

  /// Drops matches that are behind the camera or not finite, and computes the weights of all
  /// others, at a motion.
  void linearizeWeights(const Eigen::Isometry3d& T_curr_prev) {
    point_weights_.assign(point_active_.size(), {});
    line_weights_.assign(line_active_.size(), {});
    for (std::size_t i = 0; i < point_active_.size(); ++i) {
      const PointCorrespondence& point = correspondences_.points[i];
      const PointResidual residual(point, camera_, T_curr_prev, images_);
      point_active_[i] = point_active_[i] && residual.valid && residual.value.allFinite();
      if (!point_active_[i]) continue;
      point_weights_[i] = sqrtInformation(point.sigma_px, residual.by_point, point.covariance,
                                          parameters_.use_triangulation_covariance);
      point_active_[i] = point_weights_[i].size() > 0;
    }
    for (std::size_t i = 0; i < line_active_.size(); ++i) {
      const LineCorrespondence& line = correspondences_.lines[i];
      const LineResidual residual(line, camera_, T_curr_prev, images_);
      line_active_[i] = line_active_[i] && residual.valid && residual.value.allFinite();
      if (!line_active_[i]) continue;
      line_weights_[i] = sqrtInformation(line.sigma_px, residual.by_end_points, line.covariance,
                                         parameters_.use_triangulation_covariance);
      line_active_[i] = line_weights_[i].size() > 0;
    }
  }

  struct Solution {
    bool usable = false;
    Eigen::Isometry3d T_curr_prev = Eigen::Isometry3d::Identity();
    int iterations = 0;
  };

  /// Levenberg-Marquardt from a start; the rotation can be held.
  Solution solve(const Eigen::Isometry3d& T_curr_prev, bool hold_rotation) const {
    MotionVector motion = MotionVector::from(T_curr_prev);
    ceres::HuberLoss huber(parameters_.huber_delta);
    ceres::Problem::Options problem_options;
    problem_options.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
    ceres::Problem problem(problem_options);
    problem.AddParameterBlock(motion.rotation.data(), 3);
    problem.AddParameterBlock(motion.translation.data(), 3);
    if (hold_rotation) problem.SetParameterBlockConstant(motion.rotation.data());
    for (std::size_t i = 0; i < point_active_.size(); ++i) {
      if (!point_active_[i]) continue;
      problem.AddResidualBlock(pointCost(i), &huber, motion.rotation.data(),
                               motion.translation.data());
    }
    for (std::size_t i = 0; i < line_active_.size(); ++i) {
      if (!line_active_[i]) continue;
      problem.AddResidualBlock(lineCost(i), &huber, motion.rotation.data(),
                               motion.translation.data());
    }
    ceres::Solver::Options options;
    options.linear_solver_type = ceres::DENSE_NORMAL_CHOLESKY;
    options.max_num_iterations = parameters_.max_iterations;
    options.function_tolerance = 1e-8;
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

  /// Takes the matches whose whitened residual is within the threshold per square root of its size,
  /// and no others.
  void selectInliers(const Eigen::Isometry3d& T_curr_prev) {
    const auto fits = [this](const Eigen::VectorXd& whitened) {
      const double limit = parameters_.outlier_threshold;
      return whitened.squaredNorm() <= limit * limit * static_cast<double>(whitened.size());
    };
    for (std::size_t i = 0; i < point_active_.size(); ++i) {
      if (point_weights_[i].size() == 0) continue;
      const PointResidual residual(correspondences_.points[i], camera_, T_curr_prev, images_);
      point_active_[i] = residual.valid && fits(point_weights_[i] * residual.value);
    }
    for (std::size_t i = 0; i < line_active_.size(); ++i) {
      if (line_weights_[i].size() == 0) continue;
      const LineResidual residual(correspondences_.lines[i], camera_, T_curr_prev, images_);
      line_active_[i] = residual.valid && fits(line_weights_[i] * residual.value);
    }
  }

  /// Normal matrix by (rotation, translation) of the solver's perturbation, and what the residuals
  /// amount to.
  struct Statistics {
    Matrix6d information = Matrix6d::Zero();
    double chi2 = 0.0;
    double squares_px = 0.0;
    int rows = 0;
  };

  Statistics statistics(const Eigen::Isometry3d& T_curr_prev) const {
    Statistics statistics;
    const auto add = [&](const auto& residual, const Eigen::MatrixXd& weight) {
      const Eigen::VectorXd whitened = weight * residual.value;
      const double norm = whitened.norm();
      const double huber_weight =
          norm > parameters_.huber_delta ? parameters_.huber_delta / norm : 1.0;
      const Eigen::MatrixXd J = weight * residual.by_motion;
      statistics.information += huber_weight * J.transpose() * J;
      statistics.chi2 += huber_weight * norm * norm;
      statistics.squares_px += residual.value.squaredNorm();
      statistics.rows += static_cast<int>(residual.value.size());
    };
    for (std::size_t i = 0; i < point_active_.size(); ++i) {
      if (!point_active_[i]) continue;
      const PointResidual residual(correspondences_.points[i], camera_, T_curr_prev, images_);
      if (residual.valid) add(residual, point_weights_[i]);
    }
    for (std::size_t i = 0; i < line_active_.size(); ++i) {
      if (!line_active_[i]) continue;
      const LineResidual residual(correspondences_.lines[i], camera_, T_curr_prev, images_);
      if (residual.valid) add(residual, line_weights_[i]);
    }
    return statistics;
  }

 private:
  static int countActive(const std::vector<bool>& active) {
    return static_cast<int>(std::count(active.begin(), active.end(), true));
  }

  ceres::CostFunction* pointCost(std::size_t i) const {
    const PointCorrespondence& point = correspondences_.points[i];
    if (images_ == ResidualImages::kBoth)
      return new PointCostBoth(point, camera_, point_weights_[i]);
    return new PointCostLeft(point, camera_, point_weights_[i]);
  }

  ceres::CostFunction* lineCost(std::size_t i) const {
    const LineCorrespondence& line = correspondences_.lines[i];
    if (images_ == ResidualImages::kBoth) return new LineCostBoth(line, camera_, line_weights_[i]);
    return new LineCostLeft(line, camera_, line_weights_[i]);
  }

  const Correspondences& correspondences_;
  const StereoCamera& camera_;
  const MotionParameters& parameters_;
  ResidualImages images_;
  std::vector<bool> point_active_;
  std::vector<bool> line_active_;
  std::vector<Eigen::MatrixXd>
      point_weights_;  // square roots of the information; empty where never active
  std::vector<Eigen::MatrixXd> line_weights_;
};

/// From the normal matrix of the solver's perturbation of T_curr_prev to the covariance of
/// T_prev_curr in ROS' order.
Matrix6d motionCovariance(const MotionProblem::Statistics& statistics,
                          const Eigen::Isometry3d& T_curr_prev) {
  const Eigen::SelfAdjointEigenSolver<Matrix6d> eigen(statistics.information);
  // Directions that nothing measures get a huge but finite variance.
  const double floor = std::max(1e-12 * eigen.eigenvalues().maxCoeff(), 1e-12);
  const Matrix6d inverse = eigen.eigenvectors() *
                           eigen.eigenvalues().cwiseMax(floor).cwiseInverse().asDiagonal() *
                           eigen.eigenvectors().transpose();
  const double scale = std::max(1.0, statistics.chi2 / std::max(statistics.rows - 6, 1));

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

MotionEstimate failed(MotionStatus status, const MotionProblem& problem, int iterations) {
  MotionEstimate estimate;
  estimate.status = status;
  estimate.point_inliers.assign(problem.pointActive().size(), false);
  estimate.line_inliers.assign(problem.lineActive().size(), false);
  estimate.iterations = iterations;
  return estimate;
}

MotionEstimate finished(const MotionProblem& problem, const Eigen::Isometry3d& T_curr_prev,
                        int iterations) {
  const MotionProblem::Statistics statistics = problem.statistics(T_curr_prev);
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
  return estimate;
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

MotionEstimate estimateMotion(const Correspondences& correspondences, const StereoCamera& camera,
                              const Eigen::Isometry3d& T_curr_prev_initial,
                              const MotionParameters& parameters) {
  MotionProblem problem(correspondences, camera, parameters);
  problem.linearizeWeights(T_curr_prev_initial);
  const int matches = problem.numPoints() + problem.numLines();
  if (matches < parameters.min_matches) return failed(MotionStatus::kTooFewMatches, problem, 0);

  const MotionProblem::Solution first = problem.solve(T_curr_prev_initial, false);
  if (!first.usable) return failed(MotionStatus::kSolverFailed, problem, first.iterations);
  problem.linearizeWeights(first.T_curr_prev);
  problem.selectInliers(first.T_curr_prev);
  const int inliers = problem.numPoints() + problem.numLines();
  if (inliers < parameters.min_inliers || inliers < parameters.min_inlier_ratio * matches) {
    return failed(MotionStatus::kTooFewInliers, problem, first.iterations);
  }
  const MotionProblem::Solution second = problem.solve(first.T_curr_prev, false);
  const int iterations = first.iterations + second.iterations;
  if (!second.usable) return failed(MotionStatus::kSolverFailed, problem, iterations);
  return finished(problem, second.T_curr_prev, iterations);
}

MotionEstimate fuseRotation(const MotionEstimate& direct, const Eigen::Isometry3d& T_curr_prev2,
                            const Eigen::Isometry3d& T_prev_prev2,
                            const Correspondences& correspondences, const StereoCamera& camera,
                            const MotionParameters& parameters) {
  const Eigen::Quaterniond by_two_frames(T_curr_prev2.linear() * T_prev_prev2.linear().transpose());
  const Eigen::Quaterniond by_one(direct.T_curr_prev.linear());
  Eigen::Isometry3d fused = direct.T_curr_prev;
  fused.linear() = by_one.slerp(0.5, by_two_frames).normalized().toRotationMatrix();

  MotionProblem problem(correspondences, camera, parameters);
  problem.linearizeWeights(fused);
  problem.selectInliers(fused);
  const int inliers = problem.numPoints() + problem.numLines();
  if (inliers < parameters.min_inliers) return direct;
  const MotionProblem::Solution solution = problem.solve(fused, true);
  if (!solution.usable) return direct;
  return finished(problem, solution.T_curr_prev, direct.iterations + solution.iterations);
}

}  // namespace point_line_odometry
