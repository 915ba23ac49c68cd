#include "map/bundle_adjustment.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <vector>

#include "map/bundle_landmarks.h"
#include "map/bundle_poses.h"

namespace point_line_odometry {
namespace {

constexpr double kTolerance = 1e-4;  // relative change of the cost at which the solver stops
constexpr double kGradientTolerance = 1e-10;
constexpr double kLeastQuality = 1e-3;  // of a step: the cost's decrease over the predicted one

std::vector<BundlePose> posesOf(const std::vector<BundleProblem::Frame>& frames) {
  std::vector<BundlePose> poses;
  poses.reserve(frames.size());
  int num_estimated = 0;
  for (const BundleProblem::Frame& frame : frames)
    poses.emplace_back(frame.T_map_camera, frame.fixed ? BundlePose::kFixed : num_estimated++);
  return poses;
}

int numEstimated(const std::vector<BundlePose>& poses) {
  return static_cast<int>(std::count_if(poses.begin(), poses.end(),
                                        [](const BundlePose& pose) { return !pose.fixed(); }));
}

/// The least-squares problem at its current parameters. (Not Ceres: with landmarks of two sizes it
/// computes with matrices of dynamic sizes, which takes ten times as long.)
class Bundle {
 public:
  Bundle(const StereoCamera& camera, double huber_delta, BundleProblem* problem)
      : poses_(posesOf(problem->frames)),
        points_(camera, huber_delta, &problem->points),
        lines_(camera, huber_delta, &problem->lines),
        normal_(numEstimated(poses_)) {
    for (const BundleProblem::Motion& motion : problem->motions) {
      const RelativePoseFactor factor(motion);
      if (factor.usable(poses_)) motions_.push_back(factor);
    }
  }

  /// Culls landmarks that cannot be used. False if none is left.
  bool start() {
    const bool points = points_.start(poses_);
    const bool lines = lines_.start(poses_);
    return points || lines;
  }

  /// Nothing where a landmark is behind a camera.
  std::optional<double> cost() { return cost(poses_); }

  void linearize() {
    normal_.setZero();
    points_.linearize(poses_, &normal_);
    lines_.linearize(poses_, &normal_);
    for (const RelativePoseFactor& motion : motions_) motion.linearize(poses_, &normal_);
  }

  double largestGradient() const {
    return std::max({points_.largestGradient(), lines_.largestGradient(),
                     normal_.gradient().lpNorm<Eigen::Infinity>()});
  }

  /// Computes the step for a trust region (see damping()). Returns the decrease of the cost that
  /// the linearisation predicts; not above 0 if there is no solution.
  double computeStep(double radius) {
    PoseSystem reduced = normal_;
    const Eigen::VectorXd damping = reduced.damp(radius);
    points_.eliminate(radius, &reduced);
    lines_.eliminate(radius, &reduced);
    const Eigen::VectorXd step = reduced.solve();
    moved_ = poses_;
    for (BundlePose& pose : moved_) {
      if (!pose.fixed()) pose.add(step.segment<6>(6 * pose.index));
    }
    const double of_poses = 0.5 * step.dot(damping.cwiseProduct(step) - normal_.gradient());
    return of_poses + points_.substitute(step) + lines_.substitute(step);
  }

  std::optional<double> costOfStep() { return cost(moved_); }

  void acceptStep() {
    poses_ = moved_;
    points_.acceptStep();
    lines_.acceptStep();
  }

  bool finite() const {
    return points_.finite() && lines_.finite() &&
           std::all_of(poses_.begin(), poses_.end(), [](const BundlePose& pose) {
             return pose.T_camera_map.matrix().allFinite();
           });
  }

  void apply(std::vector<BundleProblem::Frame>* frames) const {
    points_.apply();
    lines_.apply();
    for (std::size_t i = 0; i < poses_.size(); ++i) {
      if (poses_[i].fixed()) continue;
      Eigen::Isometry3d T = poses_[i].T_camera_map.inverse();
      T.linear() = Eigen::Quaterniond(T.linear()).normalized().toRotationMatrix();
      (*frames)[i].T_map_camera = T;
    }
  }

 private:
  std::optional<double> cost(const std::vector<BundlePose>& poses) {
    const std::optional<double> of_points = points_.cost(poses);
    const std::optional<double> of_lines = lines_.cost(poses);
    if (!of_points || !of_lines) return std::nullopt;
    double sum = *of_points + *of_lines;
    for (const RelativePoseFactor& motion : motions_) sum += motion.cost(poses);
    return sum;
  }

  std::vector<BundlePose> poses_;
  std::vector<BundlePose> moved_;  // by the last step
  BundleLandmarks<PointResidual<ResidualImages::kBoth>, PointEstimate, PointObservation> points_;
  BundleLandmarks<LineResidual<ResidualImages::kBoth>, LineEstimate, LineObservation> lines_;
  std::vector<RelativePoseFactor> motions_;
  PoseSystem normal_;
};

/// Levenberg-Marquardt with the trust region of Ceres: the radius grows with the quality of steps
/// (Madsen, Nielsen and Tingleff, Methods for Non-Linear Least Squares Problems, 2004). False if no
/// step decreased the cost.
bool minimize(int max_iterations, Bundle* bundle) {
  const std::optional<double> initial = bundle->cost();
  if (!initial) return false;
  double cost = *initial;
  double radius = 1e4;
  double narrowing = 2.0;
  bundle->linearize();
  if (bundle->largestGradient() <= kGradientTolerance) return true;
  for (int iteration = 1; iteration <= max_iterations; ++iteration) {
    const double predicted = bundle->computeStep(radius);
    const std::optional<double> next = predicted > 0.0 ? bundle->costOfStep() : std::nullopt;
    if (next && std::abs(cost - *next) <= kTolerance * cost) return true;
    const double quality = next ? (cost - *next) / predicted : 0.0;
    if (!(quality > kLeastQuality)) {
      radius /= narrowing;
      narrowing *= 2.0;
      continue;
    }
    bundle->acceptStep();
    cost = *next;
    radius /= std::max(1.0 / 3.0, 1.0 - std::pow(2.0 * quality - 1.0, 3));
    narrowing = 2.0;
    if (iteration < max_iterations) bundle->linearize();
  }
  return cost < *initial;
}

}  // namespace

bool adjustBundle(const StereoCamera& camera, const MotionParameters& parameters,
                  int max_iterations, BundleProblem* problem) {
  Bundle bundle(camera, parameters.huber_delta, problem);
  if (!bundle.start() || !minimize(max_iterations, &bundle) || !bundle.finite()) return false;
  bundle.apply(&problem->frames);
  return true;
}

}  // namespace point_line_odometry
