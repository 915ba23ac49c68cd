#include "map/bundle_poses.h"

namespace point_line_odometry {

struct RelativePoseFactor::Error {
  Eigen::Isometry3d T_from_to;
  Eigen::Isometry3d T;  // the error: T_to_from_known T_from_to
  Vector6d residual;
};

RelativePoseFactor::RelativePoseFactor(const BundleProblem::Motion& motion)
    : from_(motion.from),
      to_(motion.to),
      T_to_from_known_(motion.T_from_to.inverse()),
      sqrt_information_(motion.covariance.llt().matrixL().solve(Matrix6d::Identity())) {}

auto RelativePoseFactor::errorAt(const std::vector<BundlePose>& poses) const -> Error {
  Error error;
  error.T_from_to = poses[from_].T_camera_map * poses[to_].T_camera_map.inverse();
  error.T = T_to_from_known_ * error.T_from_to;
  Vector6d difference;
  difference << error.T.translation(), logSO3(error.T.linear());
  error.residual = sqrt_information_ * difference;
  return error;
}

bool RelativePoseFactor::usable(const std::vector<BundlePose>& poses) const {
  return sqrt_information_.allFinite() && errorAt(poses).residual.allFinite();
}

double RelativePoseFactor::cost(const std::vector<BundlePose>& poses) const {
  return 0.5 * errorAt(poses).residual.squaredNorm();
}

void RelativePoseFactor::linearize(const std::vector<BundlePose>& poses, PoseSystem* system) const {
  const BundlePose& from = poses[from_];
  const BundlePose& to = poses[to_];
  const Error error = errorAt(poses);
  // The Jacobian of logSO3() is taken as the identity: the difference is small.
  const Eigen::Matrix3d& R = T_to_from_known_.linear();
  const Eigen::Vector3d t = to.T_camera_map.translation();
  Matrix6d J_from = Matrix6d::Zero();
  J_from.block<3, 3>(0, 0) = R * skew(error.T_from_to.linear() * t);
  J_from.block<3, 3>(0, 3) = R;
  J_from.block<3, 3>(3, 0) = R;
  J_from = sqrt_information_ * from.byIncrement<6>(J_from);
  Matrix6d J_to = Matrix6d::Zero();
  J_to.block<3, 3>(0, 0) = -error.T.linear() * skew(t);
  J_to.block<3, 3>(0, 3) = -error.T.linear();
  J_to.block<3, 3>(3, 0) = -error.T.linear();
  J_to = sqrt_information_ * to.byIncrement<6>(J_to);
  const auto add = [&](const BundlePose& pose, const Matrix6d& J) {
    if (pose.fixed()) return;
    system->add(pose.index, pose.index, J.transpose() * J);
    system->addGradient(pose.index, J.transpose() * error.residual);
  };
  add(from, J_from);
  add(to, J_to);
  if (from.fixed() || to.fixed()) return;
  const bool to_is_later = to.index > from.index;
  const Matrix6d J_to_from = J_to.transpose() * J_from;
  if (to_is_later) {
    system->add(to.index, from.index, J_to_from);
  } else {
    system->add(from.index, to.index, J_to_from.transpose());
  }
}

}  // namespace point_line_odometry
