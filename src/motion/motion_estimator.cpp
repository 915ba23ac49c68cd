#include "motion/motion_estimator.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <numeric>
#include <optional>
#include <vector>

#include "geometry/se3.h"
#include "motion/motion_covariance.h"
#include "motion/motion_problem.h"

namespace point_line_odometry {
namespace {

// Relative change of the cost at which the solver stops: before outliers are removed, and after.
constexpr double kCoarseTolerance = 1e-5;
constexpr double kFineTolerance = 1e-6;

// Far points are shifted by a translation that was found before. If that was wrong by more than
// twice the noise of a pixel, at the largest disparity of a far point, it is solved again until the
// shift has settled.
constexpr double kWrongShiftPx = 0.25;
constexpr double kSettledShiftPx = 0.02;
constexpr int kMaxRounds = 30;

/// Which matches are near a prediction, and how many must agree with their motion.
struct NearLimits {
  double distance_px;   ///< largest reprojection error
  double ratio_factor;  ///< on motion/min_inlier_ratio
};

// A minority near the prediction suffices: the others may belong to something that moves otherwise.
// If that finds too few, a camera that shakes may have moved them further: then most must agree, as
// within so many pixels wrong ones do, too.
constexpr NearLimits kNear = {2.0, 0.5};
constexpr NearLimits kNearShaken = {8.0, 2.0};

// A match with more leverage than this determines a third of an axis by itself.
constexpr double kHighLeverage = 0.3;

// Limit of a match's squared whitened residual where two motions are compared, and by how much the
// costs must differ: a match more that agrees with one of them would.
constexpr double kLimitedCost = 9.0;
constexpr double kLowerCost = 1.0;

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
  const ResidualStatistics statistics = problem.statistics(T_curr_prev);
  MotionEstimate estimate;
  estimate.status = MotionStatus::kOk;
  estimate.T_curr_prev = T_curr_prev;
  estimate.covariance = motionCovariance(statistics, T_curr_prev);
  if (problem.prior() != nullptr) {
    estimate.covariance =
        fusedCovariance(estimate.covariance, problem.prior()->informationAt(T_curr_prev));
  }
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

struct MatchCounts {
  int all;
  int near;  // those that constrain the translation
};

MatchCounts countMatches(const MotionProblem& problem) {
  return {problem.numPoints() + problem.numLines(), problem.numNear()};
}

bool areEnough(int inliers, int matches, const MotionParameters& parameters) {
  return inliers >= parameters.min_inliers && inliers >= parameters.min_inlier_ratio * matches;
}

/// Whether matches carry the translation: a few wrong ones agree with some motion within the limit
/// of inliers, but hardly as well as their noise says.
bool nearAreEnough(const MotionProblem& problem, const Eigen::Isometry3d& T_curr_prev,
                   const MatchCounts& matches, const MotionParameters& parameters) {
  return areEnough(problem.numNear(), matches.near, parameters) &&
         std::lround(problem.expectedRightNear(T_curr_prev)) >= parameters.min_inliers;
}

/// Solves again, from the motion after outliers were removed, until the translation by which far
/// points are shifted is the one that is estimated.
MotionProblem::SolveResult settleFarPoints(MotionProblem::SolveResult solved, double baseline_m,
                                           MotionProblem* problem) {
  const MatchCounts inliers = countMatches(*problem);
  if (inliers.near == 0 || inliers.near == inliers.all) return solved;
  for (int round = 0; round < kMaxRounds && solved.usable; ++round) {
    const Eigen::Vector3d& translation = solved.T_curr_prev.translation();
    const double most_px = round == 0 ? kWrongShiftPx : kSettledShiftPx;
    // What has a disparity of a pixel moves by a pixel with a baseline.
    if ((translation - problem->translationOfFar()).norm() <= most_px * baseline_m) break;
    problem->selectAll();
    problem->relinearize(solved.T_curr_prev);
    problem->selectInliers(solved.T_curr_prev);
    const int iterations = solved.iterations;
    solved = problem->solve(solved.T_curr_prev, {false, kFineTolerance});
    solved.iterations += iterations;
  }
  return solved;
}

/// Solves again after some matches were dropped, and keeps that motion if the matches as a whole
/// agree better with it. \param drop returns how many it has dropped from the problem. \param
/// cost of all matches at a motion.
template <typename Drop, typename Cost>
MotionProblem::SolveResult solveWithout(const MotionProblem::SolveResult& solved, const Drop& drop,
                                        const Cost& cost, const MotionParameters& parameters,
                                        MotionProblem* problem) {
  const std::vector<bool> points = problem->pointActive();
  const std::vector<bool> lines = problem->lineActive();
  const auto keepFirst = [&] {
    problem->select(points, lines);
    return solved;
  };
  if (drop() == 0) return solved;
  if (countMatches(*problem).all < parameters.min_inliers) return keepFirst();
  const auto others = problem->solve(solved.T_curr_prev, {false, kFineTolerance});
  if (!others.usable) return keepFirst();
  problem->selectInliers(others.T_curr_prev);
  auto again = problem->solve(others.T_curr_prev, {false, kFineTolerance});
  if (!again.usable || cost(again.T_curr_prev) > cost(solved.T_curr_prev) - kLowerCost)
    return keepFirst();
  again.iterations += solved.iterations + others.iterations;
  return again;
}

/// A few matches of high leverage, as points whose stereo match is wrong and that so seem much
/// nearer than all others, agree with any motion that they have determined: no residual shows that
/// they are wrong (Rousseeuw and Leroy, Robust Regression and Outlier Detection, 1987). So do those
/// of a small part of the image. Tries to do without the ones, then without the others.
MotionProblem::SolveResult checkLeverage(const MotionProblem::SolveResult& solved,
                                         const MotionParameters& parameters,
                                         MotionProblem* problem) {
  if (!solved.usable) return solved;
  const auto by_single = solveWithout(
      solved, [&] { return problem->dropLeverage(solved.T_curr_prev, kHighLeverage); },
      [&](const Eigen::Isometry3d& T) { return problem->limitedCost(T, kLimitedCost); }, parameters,
      problem);
  return solveWithout(
      by_single, [&] { return problem->dropSeparated(by_single.T_curr_prev); },
      [&](const Eigen::Isometry3d& T) { return problem->limitedCostOfScene(T, kLimitedCost); },
      parameters, problem);
}

MotionEstimate solveIfEnough(const Eigen::Isometry3d& start, const MotionParameters& parameters,
                             const MatchCounts& matches, MotionProblem* problem);

/// Solves with the active matches, removes outliers, and solves again. Without
/// motion/remove_outliers they are only reported. Far points agree with any translation: if too few
/// of the other matches agree, these are dropped, and the translation remains unconstrained.
/// \param matches of which enough must agree; those that are not active, too.
MotionEstimate solveTwice(const Eigen::Isometry3d& start, const MotionParameters& parameters,
                          const MatchCounts& matches, MotionProblem* problem) {
  const bool again = parameters.remove_outliers;
  const auto first = problem->solve(start, {false, again ? kCoarseTolerance : kFineTolerance});
  if (!first.usable) return failed(MotionStatus::kSolverFailed, *problem, first.iterations);
  problem->relinearize(first.T_curr_prev);
  problem->selectInliers(first.T_curr_prev);
  const MatchCounts inliers = countMatches(*problem);
  if (!areEnough(inliers.all, matches.all, parameters))
    return failed(MotionStatus::kTooFewInliers, *problem, first.iterations);
  const bool has_both = matches.near > 0 && matches.near < matches.all;
  const auto solveWithoutNear = [&] {
    problem->dropNear();
    problem->linearizeInformation(start);  // those that are dropped have shifted the far ones
    return solveIfEnough(start, parameters, {matches.all - matches.near, 0}, problem);
  };
  if (has_both && !areEnough(inliers.near, matches.near, parameters)) return solveWithoutNear();
  if (!again) return finished(*problem, first.T_curr_prev, first.iterations);
  const double baseline_m = problem->camera().baseline_m;
  const auto with_all = settleFarPoints(problem->solve(first.T_curr_prev, {false, kFineTolerance}),
                                        baseline_m, problem);
  const auto second =
      settleFarPoints(checkLeverage(with_all, parameters, problem), baseline_m, problem);
  const int iterations = first.iterations + second.iterations;
  if (!second.usable) return failed(MotionStatus::kSolverFailed, *problem, iterations);
  if (has_both && !nearAreEnough(*problem, second.T_curr_prev, matches, parameters))
    return solveWithoutNear();
  return finished(*problem, second.T_curr_prev, iterations);
}

/// The same, of at least motion/min_matches active matches.
MotionEstimate solveIfEnough(const Eigen::Isometry3d& start, const MotionParameters& parameters,
                             const MatchCounts& matches, MotionProblem* problem) {
  if (countMatches(*problem).all < parameters.min_matches)
    return failed(MotionStatus::kTooFewMatches, *problem, 0);
  return solveTwice(start, parameters, matches, problem);
}

/// Selects the matches that agree with the motion of those near a predicted one, and again with the
/// motion of these, until they become no more: where a camera shakes, most are beyond the distance.
/// Returns that motion.
Eigen::Isometry3d selectAround(const Eigen::Isometry3d& T_curr_prev_predicted,
                               double max_distance_px, const MotionParameters& parameters,
                               MotionProblem* problem) {
  constexpr int kMostRounds = 5;
  problem->selectNear(T_curr_prev_predicted, max_distance_px);
  Eigen::Isometry3d T_curr_prev = T_curr_prev_predicted;
  int most = parameters.min_matches - 1;
  for (int round = 0; round < kMostRounds; ++round) {
    if (countMatches(*problem).all < parameters.min_matches) break;
    const auto solved = problem->solve(T_curr_prev, {false, kCoarseTolerance});
    if (!solved.usable) break;
    problem->selectInliers(solved.T_curr_prev);
    T_curr_prev = solved.T_curr_prev;
    const int agree = countMatches(*problem).all;
    if (agree <= most) break;
    most = agree;
  }
  return T_curr_prev;
}

/// \param near limits of the matches with which it begins, at the initial motion; all if not given.
MotionEstimate estimate(const Correspondences& correspondences, const StereoCamera& camera,
                        const Eigen::Isometry3d& start, const MotionParameters& parameters,
                        ThreadPool* threads, const std::optional<NearLimits>& near) {
  const auto problem = MotionProblem::make(correspondences, camera, parameters, threads);
  problem->linearizeInformation(start);
  MatchCounts matches = countMatches(*problem);
  if (!near) return solveIfEnough(start, parameters, matches, problem.get());
  // More than all matches are never asked for.
  const double factor = std::min(near->ratio_factor, 1.0 / parameters.min_inlier_ratio);
  matches.all = static_cast<int>(std::ceil(factor * matches.all));
  matches.near = static_cast<int>(std::ceil(factor * matches.near));
  const Eigen::Isometry3d around =
      selectAround(start, near->distance_px, parameters, problem.get());
  return solveIfEnough(around, parameters, matches, problem.get());
}

/// Estimates the translation with the rotation fixed; returns `frame_to_frame` if that fails.
MotionEstimate estimateTranslation(const MotionEstimate& frame_to_frame,
                                   const Eigen::Isometry3d& start,
                                   const Correspondences& correspondences,
                                   const StereoCamera& camera, const MotionParameters& parameters,
                                   ThreadPool* threads) {
  const auto problem = MotionProblem::make(correspondences, camera, parameters, threads);
  problem->linearizeInformation(start);
  problem->selectInliers(start);
  const int inliers = problem->numPoints() + problem->numLines();
  if (inliers < parameters.min_inliers) return frame_to_frame;
  if (!parameters.remove_outliers) problem->selectAll();
  const auto solve = problem->solve(start, {true, kFineTolerance});
  if (!solve.usable) return frame_to_frame;
  if (!parameters.remove_outliers) problem->selectInliers(solve.T_curr_prev);
  return finished(*problem, solve.T_curr_prev, frame_to_frame.iterations + solve.iterations);
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
                              const MotionParameters& parameters, ThreadPool* threads) {
  return estimate(correspondences, camera, T_curr_prev_initial, parameters, threads, std::nullopt);
}

MotionEstimate estimateMotionNearPrediction(const Correspondences& correspondences,
                                            const StereoCamera& camera,
                                            const Eigen::Isometry3d& T_curr_prev_predicted,
                                            const MotionParameters& parameters,
                                            ThreadPool* threads) {
  MotionEstimate near_prediction =
      estimate(correspondences, camera, T_curr_prev_predicted, parameters, threads, kNear);
  if (near_prediction.ok()) return near_prediction;
  return estimate(correspondences, camera, T_curr_prev_predicted, parameters, threads, kNearShaken);
}

std::optional<MotionEstimate> estimateWithPrior(
    const MotionEstimate& images, const PriorMotion& prior, const Correspondences& correspondences,
    const StereoCamera& camera, const MotionParameters& parameters, ThreadPool* threads) {
  const auto problem =
      MotionProblem::make(correspondences, camera, parameters, threads, &prior.factor);
  const Eigen::Isometry3d& start = images.ok() ? images.T_curr_prev : prior.T_curr_prev_predicted;
  problem->linearizeInformation(start);
  const MatchCounts matches = countMatches(*problem);
  if (images.ok()) problem->selectInliers(start);
  // The inliers of a motion are enough for one, if fewer than it takes to find it.
  MotionEstimate estimate = images.ok() ? solveTwice(start, parameters, matches, problem.get())
                                        : solveIfEnough(start, parameters, matches, problem.get());
  if (!estimate.ok()) return std::nullopt;
  return estimate;
}

bool constrainByPrediction(const Eigen::Isometry3d& T_prev_curr_predicted,
                           const Matrix6d& covariance, MotionEstimate* motion) {
  const Eigen::LLT<Matrix6d> root(covariance);
  if (root.info() != Eigen::Success) return false;
  // In units of the prediction's standard deviations, along axes in which both are independent: a
  // gain of variance / (variance + 1). The difference of covariances that the Kalman update has
  // would be that of large numbers where the motion is unknown, and might be negative.
  const Matrix6d half = root.matrixL().solve(motion->covariance);
  const Matrix6d relative = root.matrixL().solve(half.transpose());
  const Eigen::SelfAdjointEigenSolver<Matrix6d> eigen(0.5 * (relative + relative.transpose()));
  if (!(eigen.eigenvalues().maxCoeff() > 1.0)) return false;
  const Vector6d variances = eigen.eigenvalues().cwiseMax(0.0);
  const Vector6d gains = variances.array() / (variances.array() + 1.0);

  const Eigen::Isometry3d T_prev_curr = motion->T_curr_prev.inverse();
  const Vector6d to_prediction = poseDifference(T_prev_curr, T_prev_curr_predicted);
  const Matrix6d axes = root.matrixL() * eigen.eigenvectors();
  const Vector6d update = axes * gains.asDiagonal() * eigen.eigenvectors().transpose() *
                          root.matrixL().solve(to_prediction);
  const Matrix6d fused = axes * gains.asDiagonal() * axes.transpose();
  const Eigen::Isometry3d T_fused = addPoseDifference(T_prev_curr, update);
  if (!T_fused.matrix().allFinite() || !fused.allFinite()) return false;
  motion->T_curr_prev = T_fused.inverse();
  motion->covariance = 0.5 * (fused + fused.transpose());
  return true;
}

MotionEstimate fuseRotation(const MotionEstimate& frame_to_frame, const TwoFrameMotion& two_frames,
                            const Correspondences& correspondences, const StereoCamera& camera,
                            const MotionParameters& parameters, ThreadPool* threads) {
  const Eigen::Quaterniond by_two_frames(two_frames.T_curr_prev2.linear() *
                                         two_frames.T_prev_prev2.linear().transpose());
  const Eigen::Quaterniond by_one(frame_to_frame.T_curr_prev.linear());
  Eigen::Isometry3d fused = frame_to_frame.T_curr_prev;
  fused.linear() = by_one.slerp(0.5, by_two_frames).normalized().toRotationMatrix();
  MotionEstimate estimate =
      estimateTranslation(frame_to_frame, fused, correspondences, camera, parameters, threads);
  // Where the two rotations differ by more than their noise, either may be the right one.
  const Vector6d moved =
      poseDifference(estimate.T_curr_prev.inverse(), frame_to_frame.T_curr_prev.inverse());
  estimate.covariance += moved * moved.transpose();
  return estimate;
}

}  // namespace point_line_odometry
