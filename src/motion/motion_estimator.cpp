#include <ceres/problem.h>
#include <ceres/solver.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <numeric>
#include <optional>
#include <vector>

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

// What all disparities may be wrong by together: as much as is allowed for where the calibration is
// refined. It does not average out over a frame's points.
constexpr double kCalibrationPx = 0.05;

// Matches so near to a prediction are where it puts them.
constexpr double kPredictedPx = 2.0;

/// The normal matrix by (rotation, translation) of the solver's perturbation, and its share from
/// each part of the left image.
class ImageInformation {
 public:
  explicit ImageInformation(const StereoCamera& camera) : part_px_(camera.width / kColumns) {}

  void add(const Eigen::Vector2d& left_px, const Matrix6d& information) {
    whole += information;
    const Eigen::Vector2i part = (left_px / part_px_).array().floor().cast<int>();
    const auto at = std::find_if(parts_.begin(), parts_.end(),
                                 [&](const Part& known) { return known.place == part; });
    if (at != parts_.end()) {
      at->information += information;
    } else {
      parts_.push_back({part, information});
    }
  }

  /// Without the part that has the most influence on the motion (the trace of its hat matrix). What
  /// hangs on one place alone is not checked by anything: a match there that is wrong, and others
  /// of the same thing with it, agrees with the motion that it makes up.
  Matrix6d checked() const {
    if (parts_.empty()) return whole;
    const Matrix6d covariance = invert(whole);
    const auto influence = [&](const Part& part) {
      return covariance.cwiseProduct(part.information).sum();
    };
    const auto most =
        std::max_element(parts_.begin(), parts_.end(),
                         [&](const Part& a, const Part& b) { return influence(a) < influence(b); });
    return whole - most->information;
  }

  /// The inverse; directions that nothing measures get a huge but finite variance.
  static Matrix6d invert(const Matrix6d& information) {
    const Eigen::SelfAdjointEigenSolver<Matrix6d> eigen(information);
    const double floor = std::max(1e-12 * eigen.eigenvalues().maxCoeff(), 1e-12);
    return eigen.eigenvectors() * eigen.eigenvalues().cwiseMax(floor).cwiseInverse().asDiagonal() *
           eigen.eigenvectors().transpose();
  }

  Matrix6d whole = Matrix6d::Zero();

 private:
  static constexpr double kColumns = 8.0;  // parts across the image; they are square

  struct Part {
    Eigen::Vector2i place;
    Matrix6d information;
  };

  double part_px_;
  std::vector<Part> parts_;
};

Eigen::Vector2d placeOf(const PointCorrespondence& point) { return point.left_px; }
Eigen::Vector2d placeOf(const LineCorrespondence& line) {
  return 0.5 * (line.left_start_px + line.left_end_px);
}

/// What the residuals amount to.
struct Statistics {
  explicit Statistics(const StereoCamera& camera) : information(camera) {}

  ImageInformation information;
  Vector6d by_disparity = Vector6d::Zero();  // what an error of all disparities adds to J^T r [px]
  double pulls = 0.0;                        // squares of the residuals times their Huber weights
  double weights = 0.0;                      // these weights, for each row
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
        camera_(camera),
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
    Statistics statistics(camera_);
    const auto add = [&](const auto& residual, const auto& weight, const auto& match,
                         ResidualHistogram* histogram) {
      const auto whitened = (weight * residual.value).eval();
      const double norm = whitened.norm();
      const double huber_weight =
          norm > parameters_.huber_delta ? parameters_.huber_delta / norm : 1.0;
      const auto J = (weight * residual.byMotion()).eval();
      statistics.information.add(placeOf(match), huber_weight * J.transpose() * J);
      const auto rows = static_cast<int>(residual.value.size());
      statistics.pulls += huber_weight * huber_weight * norm * norm;
      statistics.weights += huber_weight * rows;
      statistics.stiffnesses += huber_weight * (huber_weight < 1.0 ? rows - 1 : rows);
      statistics.squares_px += residual.value.squaredNorm();
      statistics.rows += rows;
      for (Eigen::Index i = 0; i < whitened.size(); ++i) histogram->add(whitened[i]);
    };
    points_.forEachActive(T_curr_prev,
                          [&](const auto& residual, const auto& weight, const auto& match) {
                            add(residual, weight, match, &statistics.points);
                            addDisparityError(residual, weight, match, &statistics.by_disparity);
                          });
    lines_.forEachActive(T_curr_prev,
                         [&](const auto& residual, const auto& weight, const auto& match) {
                           add(residual, weight, match, &statistics.lines);
                         });
    return statistics;
  }

 private:
  /// An error of the calibration that makes every disparity larger: points seem nearer, and their
  /// right pixels now lie further left.
  template <typename Weight>
  void addDisparityError(const PointResidual<kImages>& residual, const Weight& weight,
                         const PointCorrespondence& point, Vector6d* by_disparity) const {
    const bool in_front = point.p_prev.z() > camera_.baseline_m;  // a landmark need not be
    if (!in_front || !parameters_.use_triangulation_covariance) return;
    const double disparity_px = camera_.fx * camera_.baseline_m / point.p_prev.z();
    auto change = (residual.byLandmark() * (-point.p_prev / disparity_px)).eval();
    if constexpr (kImages == ResidualImages::kBoth) change(2) -= 1.0;
    const auto J = (weight * residual.byMotion()).eval();
    *by_disparity += J.transpose() * (weight * change);
  }

  const MotionParameters& parameters_;
  const StereoCamera& camera_;
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
  const Matrix6d inverse = ImageInformation::invert(statistics.information.checked());
  const double scale = covarianceScale(statistics);
  const Vector6d by_calibration = kCalibrationPx * inverse * statistics.by_disparity;
  const Matrix6d of_solution = scale * inverse + by_calibration * by_calibration.transpose();

  // R_prev_curr = R^T and t_prev_curr = -R^T t under (exp(rotation) R, t + translation).
  const Eigen::Matrix3d R_t = T_curr_prev.linear().transpose();
  const Eigen::Vector3d& t = T_curr_prev.translation();
  Matrix6d J = Matrix6d::Zero();
  J.block<3, 3>(0, 0) = -R_t * skew(t);
  J.block<3, 3>(0, 3) = -R_t;
  J.block<3, 3>(3, 0) = -R_t;
  const Matrix6d covariance = J * of_solution * J.transpose();
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

bool supportByPrediction(const Eigen::Isometry3d& T_prev_curr_predicted, const Matrix6d& covariance,
                         MotionEstimate* motion) {
  const Eigen::LLT<Matrix6d> root(covariance);
  if (root.info() != Eigen::Success) return false;
  // In units of the prediction's standard deviations.
  const Matrix6d half = root.matrixL().solve(motion->covariance);
  const Matrix6d relative = root.matrixL().solve(half.transpose());
  const Eigen::SelfAdjointEigenSolver<Matrix6d> eigen(relative, Eigen::EigenvaluesOnly);
  if (!(eigen.eigenvalues().maxCoeff() > 1.0)) return false;

  const Eigen::Isometry3d T_prev_curr = motion->T_curr_prev.inverse();
  const Eigen::AngleAxisd turn(T_prev_curr_predicted.linear() * T_prev_curr.linear().transpose());
  Vector6d to_prediction;
  to_prediction << T_prev_curr_predicted.translation() - T_prev_curr.translation(),
      turn.angle() * turn.axis();
  const Eigen::LDLT<Matrix6d> sum(motion->covariance + covariance);
  const Vector6d change = motion->covariance * sum.solve(to_prediction);
  const Matrix6d known = covariance - covariance * sum.solve(covariance);
  const double angle = change.tail<3>().norm();
  Eigen::Isometry3d T_supported = T_prev_curr;
  T_supported.translation() += change.head<3>();
  if (angle > 0.0) {
    T_supported.linear() =
        Eigen::AngleAxisd(angle, change.tail<3>() / angle) * T_prev_curr.linear();
  }
  if (!T_supported.matrix().allFinite() || !known.allFinite()) return false;
  motion->T_curr_prev = T_supported.inverse();
  motion->covariance = 0.5 * (known + known.transpose());
  return true;
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
