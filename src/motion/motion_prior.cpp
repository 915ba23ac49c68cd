#include "point_line_odometry/motion_prior.h"

#include <Eigen/Cholesky>

#include "geometry/se3.h"

namespace point_line_odometry {
namespace {

// Standard deviations of axes that no prior knows.
constexpr double kNoPrior_m = 100.0;
constexpr double kNoPrior_rad = 10.0;

}  // namespace

/// With T = X^-1 D X the errors are dr_body = R_X dr and dt_body = R_X dt - dr_body x (R_D t_X).
MotionPrior ofCamera(const MotionPrior& of_body, const Eigen::Isometry3d& T_body_camera) {
  const Eigen::Matrix3d& R = T_body_camera.linear();
  Matrix6d J = blockRotation(R);
  J.topRightCorner<3, 3>() = skew(of_body.T_prev_curr.linear() * T_body_camera.translation()) * R;
  MotionPrior prior = of_body;
  prior.T_prev_curr = T_body_camera.inverse() * of_body.T_prev_curr * T_body_camera;
  const Matrix6d information = J.transpose() * of_body.information * J;
  prior.information = 0.5 * (information + information.transpose());
  return prior;
}

/// Gauss-Newton; the priors' motions differ by their errors, so that a few iterations suffice.
std::optional<MotionPrior> fused(const std::vector<MotionPrior>& priors) {
  constexpr int kIterations = 4;
  if (priors.empty()) return std::nullopt;
  MotionPrior result = priors.front();
  if (priors.size() == 1) return result;
  for (std::size_t i = 1; i < priors.size(); ++i) result.information += priors[i].information;
  Vector6d unknown;
  unknown << Eigen::Vector3d::Constant(kNoPrior_m), Eigen::Vector3d::Constant(kNoPrior_rad);
  Matrix6d bounded = result.information;
  bounded.diagonal() += unknown.cwiseAbs2().cwiseInverse();
  const Eigen::LLT<Matrix6d> root(bounded);
  if (root.info() != Eigen::Success) return priors.front();
  for (int k = 0; k < kIterations; ++k) {
    Vector6d pull = Vector6d::Zero();
    for (const MotionPrior& prior : priors)
      pull += prior.information * poseDifference(result.T_prev_curr, prior.T_prev_curr);
    result.T_prev_curr = addPoseDifference(result.T_prev_curr, root.solve(pull));
  }
  return result;
}

const char* toString(PriorUse use) {
  switch (use) {
    case PriorUse::kNone:
      return "none";
    case PriorUse::kUsed:
      return "used";
    case PriorUse::kCarried:
      return "carried";
    case PriorUse::kRejected:
      return "rejected";
    case PriorUse::kSuspended:
      return "suspended";
    case PriorUse::kInvalid:
      return "invalid";
  }
  return "unknown";
}

}  // namespace point_line_odometry
