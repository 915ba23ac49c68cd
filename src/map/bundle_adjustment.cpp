#include "map/bundle_adjustment.h"

#include <ceres/loss_function.h>
#include <ceres/ordered_groups.h>
#include <ceres/problem.h>
#include <ceres/sized_cost_function.h>
#include <ceres/solver.h>

#include <algorithm>
#include <array>
#include <cstddef>
#include <deque>
#include <vector>

#include "geometry/skew.h"
#include "motion/motion_cost.h"

namespace point_line_odometry {
namespace {

constexpr double kTolerance = 1e-4;  // relative change of the cost at which the solver stops
constexpr auto kBoth = ResidualImages::kBoth;

/// A pose that the solver changes: T_camera_map = (exp(rotation) R_0, t_0 + translation), the six
/// unknowns beginning at zero.
struct PoseUnknown {
  Eigen::Isometry3d T_camera_map_start;
  std::array<double, 6> change{};

  explicit PoseUnknown(const Eigen::Isometry3d& T_map_camera)
      : T_camera_map_start(T_map_camera.inverse()) {}

  Eigen::Isometry3d at(const double* change_now) const {
    MotionVector change;
    change.rotation = Eigen::Map<const Eigen::Vector3d>(change_now);
    const Eigen::Isometry3d R = change.toIsometry();
    Eigen::Isometry3d T;
    T.linear() = R.linear() * T_camera_map_start.linear();
    T.translation() =
        T_camera_map_start.translation() + Eigen::Map<const Eigen::Vector3d>(change_now + 3);
    T.makeAffine();
    return T;
  }
};

/// One sight of one landmark; the landmark's unknowns count standard deviations of its belief.
template <typename Residual, typename Place, typename Sight>
class SightCost : public ceres::SizedCostFunction<Residual::kRows, Place::kNumFreedoms, 6> {
 public:
  SightCost(const StereoCamera* camera, const Place* place, PoseUnknown* pose, const Sight* sight)
      : camera_(camera), place_(place), pose_(pose), sight_(sight) {}

  double* poseChange() const { return pose_->change.data(); }

  /// True if the solver can start: the landmark is in front of the camera, and the residual and its
  /// derivatives are finite.
  bool usable() const {
    const Freedoms change = Freedoms::Zero();
    const double* unknowns[] = {change.data(), poseChange()};
    Eigen::Matrix<double, Residual::kRows, 1> residual;
    ByLandmark by_landmark;
    ByPose by_pose;
    double* jacobians[] = {by_landmark.data(), by_pose.data()};
    return Evaluate(unknowns, residual.data(), jacobians) && by_landmark.allFinite() &&
           by_pose.allFinite();
  }

  /// False if the landmark gets behind the camera, or the residual is not finite: the solver takes
  /// a smaller step.
  bool Evaluate(double const* const* unknowns, double* residuals,
                double** jacobians) const override {
    Place place;
    place.value = place_->value + place_->spread * Eigen::Map<const Freedoms>(unknowns[0]);
    const Residual residual(correspondence(place, *sight_), *camera_, pose_->at(unknowns[1]));
    if (!residual.valid || !residual.value.allFinite()) return false;
    const double weight = 1.0 / sight_->sigma_px;
    Eigen::Map<Eigen::Matrix<double, Residual::kRows, 1>>{residuals} = weight * residual.value;
    if (jacobians == nullptr) return true;
    if (jacobians[0] != nullptr) {
      Eigen::Map<ByLandmark>{jacobians[0]} = weight * residual.byLandmark() * place_->spread;
    }
    if (jacobians[1] != nullptr) {
      Eigen::Map<ByPose> J(jacobians[1]);
      const auto by_motion = residual.byMotion();
      J.template leftCols<3>() = weight * by_motion.template leftCols<3>() *
                                 leftJacobian(Eigen::Map<const Eigen::Vector3d>(unknowns[1]));
      J.template rightCols<3>() = weight * by_motion.template rightCols<3>();
    }
    return true;
  }

 private:
  using Freedoms = Eigen::Matrix<double, Place::kNumFreedoms, 1>;
  using ByLandmark = Eigen::Matrix<double, Residual::kRows, Place::kNumFreedoms, Eigen::RowMajor>;
  using ByPose = Eigen::Matrix<double, Residual::kRows, 6, Eigen::RowMajor>;

  const StereoCamera* camera_;
  const Place* place_;
  PoseUnknown* pose_;
  const Sight* sight_;
};

/// How far the motion between two poses is from one that is known: translation along and rotation
/// about the axes of the second, weighted.
class MotionPriorCost : public ceres::SizedCostFunction<6, 6, 6> {
 public:
  MotionPriorCost(const BundleProblem::Motion& motion, const PoseUnknown* from,
                  const PoseUnknown* to)
      : T_to_from_known_(motion.T_from_to.inverse()),
        from_(from),
        to_(to),
        weight_(motion.covariance.llt().matrixL().solve(Matrix6d::Identity())) {}

  /// True if it can be evaluated where the solver starts.
  bool usable() const {
    const double* unknowns[] = {from_->change.data(), to_->change.data()};
    Vector6d residual;
    return Evaluate(unknowns, residual.data(), nullptr) && residual.allFinite() &&
           weight_.allFinite();
  }

  bool Evaluate(double const* const* unknowns, double* residuals,
                double** jacobians) const override {
    const Eigen::Isometry3d T_from_map = from_->at(unknowns[0]);
    const Eigen::Isometry3d T_to_map = to_->at(unknowns[1]);
    const Eigen::Isometry3d T_from_to = T_from_map * T_to_map.inverse();
    const Eigen::Isometry3d error = T_to_from_known_ * T_from_to;
    const Eigen::AngleAxisd turn(error.linear());
    Vector6d difference;
    difference << error.translation(), turn.angle() * turn.axis();
    Eigen::Map<Vector6d>{residuals} = weight_ * difference;
    if (jacobians == nullptr) return true;
    // The difference is small: derivatives of its rotation as if it were zero.
    using Jacobian = Eigen::Matrix<double, 6, 6, Eigen::RowMajor>;
    const Eigen::Matrix3d& R = T_to_from_known_.linear();
    const Eigen::Matrix3d R_from_to = T_from_to.linear();
    if (jacobians[0] != nullptr) {
      Matrix6d J = Matrix6d::Zero();
      const Eigen::Matrix3d left = leftJacobian(Eigen::Map<const Eigen::Vector3d>(unknowns[0]));
      J.block<3, 3>(0, 0) = R * skew(R_from_to * T_to_map.translation()) * left;
      J.block<3, 3>(0, 3) = R;
      J.block<3, 3>(3, 0) = R * left;
      Eigen::Map<Jacobian>{jacobians[0]} = weight_ * J;
    }
    if (jacobians[1] != nullptr) {
      Matrix6d J = Matrix6d::Zero();
      const Eigen::Matrix3d left = leftJacobian(Eigen::Map<const Eigen::Vector3d>(unknowns[1]));
      J.block<3, 3>(0, 0) = -error.linear() * skew(T_to_map.translation()) * left;
      J.block<3, 3>(0, 3) = -error.linear();
      J.block<3, 3>(3, 0) = -error.linear() * left;
      Eigen::Map<Jacobian>{jacobians[1]} = weight_ * J;
    }
    return true;
  }

 private:
  Eigen::Isometry3d T_to_from_known_;
  const PoseUnknown* from_;
  const PoseUnknown* to_;
  Matrix6d weight_;
};

/// The solver's view of the landmarks of one kind.
template <typename Residual, typename Place, typename Sight>
class LandmarkUnknowns {
 public:
  using Landmark = BundleProblem::Landmark<Place, Sight>;

  /// \param changes numUnknowns(*landmarks) numbers that are zero; must outlive this.
  LandmarkUnknowns(std::vector<Landmark>* landmarks, double* changes)
      : landmarks_(*landmarks), changes_(changes) {}

  static std::size_t numUnknowns(const std::vector<Landmark>& landmarks) {
    return landmarks.size() * Place::kNumFreedoms;
  }

  /// All but those that a sight cannot be evaluated of: these are marked as culled.
  void addTo(ceres::Problem* problem, ceres::ParameterBlockOrdering* ordering,
             ceres::LossFunction* loss, const StereoCamera& camera,
             std::vector<PoseUnknown>* poses) {
    for (std::size_t i = 0; i < landmarks_.size(); ++i) {
      Landmark& landmark = landmarks_[i];
      for (const auto& sight : landmark.sights) {
        costs_.emplace_back(&camera, &landmark.place,
                            &(*poses)[static_cast<std::size_t>(sight.frame)], &sight.sight);
      }
      const auto first = costs_.end() - static_cast<std::ptrdiff_t>(landmark.sights.size());
      landmark.culled =
          !std::all_of(first, costs_.end(), [](const auto& cost) { return cost.usable(); });
      if (landmark.culled) continue;
      for (auto cost = first; cost != costs_.end(); ++cost)
        problem->AddResidualBlock(&*cost, loss, change(i).data(), cost->poseChange());
      ordering->AddElementToGroup(change(i).data(), 0);
    }
  }

  bool finite() const {
    for (std::size_t i = 0; i < landmarks_.size(); ++i) {
      if (!change(i).allFinite()) return false;
    }
    return true;
  }

  void apply() {
    for (std::size_t i = 0; i < landmarks_.size(); ++i)
      landmarks_[i].place.value += landmarks_[i].place.spread * change(i);
  }

 private:
  Eigen::Map<Eigen::Matrix<double, Place::kNumFreedoms, 1>> change(std::size_t i) const {
    return {changes_ + i * Place::kNumFreedoms, Place::kNumFreedoms, 1};
  }

  std::vector<Landmark>& landmarks_;
  double* changes_;
  std::deque<SightCost<Residual, Place, Sight>> costs_;
};

/// Ceres writes to its log, whatever the options, when the start cannot be evaluated, when
/// residuals are not finite, and after too many invalid steps in a row. None of these is left to
/// happen: the log belongs to the process, which may be another's.
ceres::Solver::Options solverOptions(int max_iterations) {
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::DENSE_SCHUR;
  options.max_num_iterations = max_iterations;
  options.max_num_consecutive_invalid_steps = max_iterations + 1;
  options.function_tolerance = kTolerance;
  options.num_threads = 1;
  options.logging_type = ceres::SILENT;
  return options;
}

/// True if the solver has found something: not if each of its steps failed.
bool hasSolution(const ceres::Solver::Summary& summary) {
  return summary.IsSolutionUsable() && (summary.termination_type == ceres::CONVERGENCE ||
                                        summary.final_cost < summary.initial_cost);
}

}  // namespace

bool adjustBundle(const StereoCamera& camera, const MotionParameters& parameters,
                  int max_iterations, BundleProblem* bundle) {
  std::vector<PoseUnknown> poses;
  poses.reserve(bundle->frames.size());
  for (const BundleProblem::Frame& frame : bundle->frames) poses.emplace_back(frame.T_map_camera);
  using Points = LandmarkUnknowns<PointResidual<kBoth>, PointBelief, PointSight>;
  using Lines = LandmarkUnknowns<LineResidual<kBoth>, LineBelief, LineSight>;
  // The solver eliminates them in the order of their addresses: in one piece of memory that is
  // always the same.
  const std::size_t num_of_points = Points::numUnknowns(bundle->points);
  std::vector<double> changes(num_of_points + Lines::numUnknowns(bundle->lines), 0.0);
  Points points(&bundle->points, changes.data());
  Lines lines(&bundle->lines, changes.data() + num_of_points);

  ceres::Problem::Options problem_options;
  problem_options.cost_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  problem_options.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  problem_options.disable_all_safety_checks = true;
  ceres::Problem problem(problem_options);
  ceres::HuberLoss loss(parameters.huber_delta);
  ceres::Solver::Options options = solverOptions(max_iterations);
  auto* ordering = new ceres::ParameterBlockOrdering;
  options.linear_solver_ordering.reset(ordering);
  points.addTo(&problem, ordering, &loss, camera, &poses);
  lines.addTo(&problem, ordering, &loss, camera, &poses);
  if (problem.NumResidualBlocks() == 0) return false;
  std::deque<MotionPriorCost> motions;
  for (const BundleProblem::Motion& motion : bundle->motions) {
    PoseUnknown& from = poses[static_cast<std::size_t>(motion.from)];
    PoseUnknown& to = poses[static_cast<std::size_t>(motion.to)];
    motions.emplace_back(motion, &from, &to);
    if (!motions.back().usable()) continue;
    problem.AddResidualBlock(&motions.back(), nullptr, from.change.data(), to.change.data());
  }
  for (std::size_t i = 0; i < poses.size(); ++i) {
    if (!problem.HasParameterBlock(poses[i].change.data())) continue;
    if (bundle->frames[i].fixed) problem.SetParameterBlockConstant(poses[i].change.data());
    ordering->AddElementToGroup(poses[i].change.data(), 1);
  }

  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);
  if (!hasSolution(summary) || !points.finite() || !lines.finite()) return false;
  for (const PoseUnknown& pose : poses) {
    if (!pose.at(pose.change.data()).matrix().allFinite()) return false;
  }

  points.apply();
  lines.apply();
  for (std::size_t i = 0; i < poses.size(); ++i) {
    if (bundle->frames[i].fixed) continue;
    Eigen::Isometry3d T = poses[i].at(poses[i].change.data()).inverse();
    T.linear() = Eigen::Quaterniond(T.linear()).normalized().toRotationMatrix();
    bundle->frames[i].T_map_camera = T;
  }
  return true;
}

}  // namespace point_line_odometry
