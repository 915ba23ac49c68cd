#include "motion/motion_problem.h"

#include <ceres/problem.h>
#include <ceres/solver.h>

#include <Eigen/Cholesky>
#include <cstddef>
#include <optional>

#include "motion/huber_loss.h"
#include "motion/motion_cost.h"
#include "motion/patch_overlap.h"
#include "motion/solution_separation.h"
#include "motion/weighted_matches.h"

namespace point_line_odometry {
namespace {

// Iterations of the solver at most: with 100 of them all figures of the test sequences are equal.
constexpr int kMaxSolverIterations = 20;

/// With residuals of the left image or of both.
template <ResidualImages kImages>
class MotionProblemOf final : public MotionProblem {
 public:
  MotionProblemOf(const Correspondences& correspondences, const StereoCamera& camera,
                  const MotionParameters& parameters, ThreadPool* threads, const PriorFactor* prior)
      : MotionProblem(camera, prior),
        parameters_(parameters),
        threads_(threads),
        disparity_error_px_(correspondences.disparity_error_px),
        shutter_(correspondences.shutter),
        points_(correspondences.points, camera),
        lines_(correspondences.lines, camera) {}

  int numPoints() const override { return points_.count(); }
  int numLines() const override { return lines_.count(); }
  int numNear() const override { return points_.countNear() + lines_.countNear(); }
  double expectedRightNear(const Eigen::Isometry3d& T_curr_prev) const override {
    return points_.expectedRightNear(T_curr_prev, parameters_.outlier_threshold) +
           lines_.expectedRightNear(T_curr_prev, parameters_.outlier_threshold);
  }
  const std::vector<bool>& pointActive() const override { return points_.active(); }
  const std::vector<bool>& lineActive() const override { return lines_.active(); }

  void linearizeInformation(const Eigen::Isometry3d& T_curr_prev) override {
    points_.linearizeInformation(T_curr_prev, parameters_.use_triangulation_covariance);
    lines_.linearizeInformation(T_curr_prev, parameters_.use_triangulation_covariance);
  }

  void relinearize(const Eigen::Isometry3d& T_curr_prev) override {
    if (parameters_.use_triangulation_covariance) points_.refineLandmarks(T_curr_prev);
    linearizeInformation(T_curr_prev);
  }

  void selectInliers(const Eigen::Isometry3d& T_curr_prev) override {
    points_.selectInliers(T_curr_prev, parameters_.outlier_threshold);
    lines_.selectInliers(T_curr_prev, parameters_.outlier_threshold);
  }

  const Eigen::Vector3d& translationOfFar() const override { return points_.translationOfFar(); }

  void selectAll() override {
    points_.selectAll();
    lines_.selectAll();
  }

  void selectNear(const Eigen::Isometry3d& T_curr_prev, double max_distance_px) override {
    points_.selectNear(T_curr_prev, max_distance_px);
    lines_.selectNear(T_curr_prev, max_distance_px);
  }

  void select(const std::vector<bool>& points, const std::vector<bool>& lines) override {
    points_.select(points);
    lines_.select(lines);
  }

  int dropLeverage(const Eigen::Isometry3d& T_curr_prev, double limit) override {
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

  int dropSeparated(const Eigen::Isometry3d& T_curr_prev) override {
    SolutionSeparation separation(camera());
    if (prior() != nullptr) {
      const PriorFactor::Linearization linear = prior()->linearize(T_curr_prev);
      separation.addPrior(linear.loss.weight * linear.jacobian.transpose() * linear.jacobian);
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

  double limitedCost(const Eigen::Isometry3d& T_curr_prev, double limit) const override {
    return points_.limitedCost(T_curr_prev, limit, std::vector<double>(points_.size(), 1.0)) +
           lines_.limitedCost(T_curr_prev, limit, std::vector<double>(lines_.size(), 1.0));
  }

  double limitedCostOfScene(const Eigen::Isometry3d& T_curr_prev, double limit) const override {
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

  void dropNear() override {
    points_.dropNear();
    lines_.dropNear();
  }

  SolveResult solve(const Eigen::Isometry3d& T_curr_prev,
                    const SolveOptions& options) const override {
    MotionVector motion = MotionVector::from(T_curr_prev);
    const MotionCost<kImages> cost(points_, lines_, parameters_.huber_delta, threads_);
    ceres::Problem::Options problem_options;
    problem_options.cost_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
    ceres::Problem problem(problem_options);
    ReducedMotionCost reduced(cost, motion, prior());
    problem.AddResidualBlock(&reduced, nullptr, motion.rotation.data(), motion.translation.data());
    if (options.fix_rotation) problem.SetParameterBlockConstant(motion.rotation.data());
    ceres::Solver::Options solver_options;
    solver_options.linear_solver_type = ceres::DENSE_NORMAL_CHOLESKY;
    solver_options.max_num_iterations = kMaxSolverIterations;
    solver_options.function_tolerance = options.function_tolerance;
    solver_options.num_threads = 1;
    solver_options.logging_type = ceres::SILENT;
    ceres::Solver::Summary summary;
    ceres::Solve(solver_options, &problem, &summary);
    SolveResult result;
    result.T_curr_prev = motion.toIsometry();
    result.usable = summary.IsSolutionUsable() && result.T_curr_prev.matrix().allFinite();
    result.iterations = static_cast<int>(summary.iterations.size()) - 1;
    return result;
  }

  ResidualStatistics statistics(const Eigen::Isometry3d& T_curr_prev) const override {
    ResidualStatistics statistics(camera(), disparity_error_px_, shutter_);
    const auto add = [&](const auto& residual, const auto& sqrt_information, const auto& match,
                         ResidualHistogram* histogram) {
      const auto whitened = (sqrt_information * residual.value).eval();
      const double norm = whitened.norm();
      const double huber_weight = HuberLoss(whitened.squaredNorm(), parameters_.huber_delta).weight;
      const auto J = (sqrt_information * residual.jacobianByMotion()).eval();
      const Matrix6d information = huber_weight * J.transpose() * J;
      statistics.information.add(
          pixelOf(match),
          {information, huber_weight * shiftOfFar(residual, sqrt_information, match),
           huber_weight * byDisparity(residual, sqrt_information, match),
           shutter_.timeOf(camera(), pixelOf(match).y()) * information});
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

  /// Derivative of J^T r by an error that makes every disparity larger: landmarks are triangulated
  /// nearer, and right pixels in frame k lie further left.
  template <typename Residual, typename SqrtInformation>
  Vector6d byDisparity(const Residual& residual, const SqrtInformation& sqrt_information,
                       const typename Residual::Correspondence& match) const {
    const std::optional<typename Residual::Value> derivative = byDisparity(residual, match);
    if (!derivative || !parameters_.use_triangulation_covariance) return Vector6d::Zero();
    const auto J = (sqrt_information * residual.jacobianByMotion()).eval();
    return J.transpose() * (sqrt_information * *derivative);
  }

  /// The same of the residual; nothing for a landmark that is not in front of frame k-1.
  std::optional<typename PointResidual<kImages>::Value> byDisparity(
      const PointResidual<kImages>& residual, const PointCorrespondence& point) const {
    const std::optional<Eigen::Vector3d> nearer = nearerByDisparity(point.p_prev);
    if (!nearer) return std::nullopt;
    typename PointResidual<kImages>::Value derivative = residual.jacobianByLandmark() * *nearer;
    if constexpr (kImages == ResidualImages::kBoth) derivative(2) -= 1.0;
    return derivative;
  }
  std::optional<typename LineResidual<kImages>::Value> byDisparity(
      const LineResidual<kImages>& residual, const LineCorrespondence& line) const {
    const std::optional<Eigen::Vector3d> start = nearerByDisparity(line.start_prev);
    const std::optional<Eigen::Vector3d> end = nearerByDisparity(line.end_prev);
    if (!start || !end) return std::nullopt;
    Vector6d nearer;
    nearer << *start, *end;
    typename LineResidual<kImages>::Value derivative = residual.jacobianByLandmark() * nearer;
    if constexpr (kImages == ResidualImages::kBoth)
      derivative.template tail<2>() -= residual.derivativeByColumn().template tail<2>();
    return derivative;
  }

  /// Derivative of a triangulated point by its disparity [m / px].
  std::optional<Eigen::Vector3d> nearerByDisparity(const Eigen::Vector3d& p_prev) const {
    const StereoCamera& camera = this->camera();
    if (!(p_prev.z() > camera.baseline_m)) return std::nullopt;  // landmarks may be behind
    const double disparity_px = camera.fx * camera.baseline_m / p_prev.z();
    return -p_prev / disparity_px;
  }

  const MotionParameters& parameters_;
  ThreadPool* threads_;
  double disparity_error_px_;
  RollingShutter shutter_;
  WeightedMatches<PointResidual<kImages>> points_;
  WeightedMatches<LineResidual<kImages>> lines_;
};

}  // namespace

std::unique_ptr<MotionProblem> MotionProblem::make(const Correspondences& correspondences,
                                                   const StereoCamera& camera,
                                                   const MotionParameters& parameters,
                                                   ThreadPool* threads, const PriorFactor* prior) {
  if (parameters.residual_images == "both") {
    return std::make_unique<MotionProblemOf<ResidualImages::kBoth>>(correspondences, camera,
                                                                    parameters, threads, prior);
  }
  return std::make_unique<MotionProblemOf<ResidualImages::kLeft>>(correspondences, camera,
                                                                  parameters, threads, prior);
}

}  // namespace point_line_odometry
