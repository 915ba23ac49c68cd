#include "geometry/se3.h"

#include <cmath>

namespace point_line_odometry {

Eigen::Matrix3d expSO3(const Eigen::Vector3d& rotation) {
  const double angle = rotation.norm();
  if (!(angle > 0.0)) return Eigen::Matrix3d::Identity();
  return Eigen::AngleAxisd(angle, rotation / angle).toRotationMatrix();
}

Eigen::Vector3d logSO3(const Eigen::Matrix3d& R) {
  const Eigen::AngleAxisd rotation(R);
  return rotation.angle() * rotation.axis();
}

double rotationAngle(const Eigen::Matrix3d& R) { return Eigen::AngleAxisd(R).angle(); }

Eigen::Matrix3d leftJacobian(const Eigen::Vector3d& w) {
  const double angle = w.norm();
  const Eigen::Matrix3d W = skew(w);
  if (angle < 1e-6) return Eigen::Matrix3d::Identity() + 0.5 * W;
  const double a2 = angle * angle;
  return Eigen::Matrix3d::Identity() + (1.0 - std::cos(angle)) / a2 * W +
         (angle - std::sin(angle)) / (a2 * angle) * W * W;
}

Vector6d poseDifference(const Eigen::Isometry3d& T_odom_a, const Eigen::Isometry3d& T_odom_b) {
  Vector6d difference;
  difference << T_odom_b.translation() - T_odom_a.translation(),
      logSO3(T_odom_b.linear() * T_odom_a.linear().transpose());
  return difference;
}

Eigen::Isometry3d addPoseDifference(const Eigen::Isometry3d& T_odom_a, const Vector6d& difference) {
  Eigen::Isometry3d T_odom_b = T_odom_a;
  T_odom_b.translation() += difference.head<3>();
  T_odom_b.linear() = expSO3(difference.tail<3>()) * T_odom_a.linear();
  return T_odom_b;
}

Matrix6d blockRotation(const Eigen::Matrix3d& R_a_b) {
  Matrix6d blocks = Matrix6d::Zero();
  blocks.topLeftCorner<3, 3>() = R_a_b;
  blocks.bottomRightCorner<3, 3>() = R_a_b;
  return blocks;
}

Matrix6d adjoint(const Eigen::Isometry3d& T_a_b) {
  Matrix6d adjoint = blockRotation(T_a_b.linear());
  adjoint.topRightCorner<3, 3>() = skew(T_a_b.translation()) * T_a_b.linear();
  return adjoint;
}

Matrix6d composeCovariance(const Eigen::Isometry3d& T_odom_prev, const Matrix6d& pose_covariance,
                           const Eigen::Isometry3d& T_prev_curr,
                           const Matrix6d& motion_covariance) {
  const Eigen::Matrix3d& R = T_odom_prev.linear();
  const Eigen::Vector3d translation = R * T_prev_curr.translation();
  Matrix6d J_pose = Matrix6d::Identity();
  J_pose.block<3, 3>(0, 3) = -skew(translation);
  const Matrix6d J_motion = blockRotation(R);
  const Matrix6d covariance = J_pose * pose_covariance * J_pose.transpose() +
                              J_motion * motion_covariance * J_motion.transpose();
  return 0.5 * (covariance + covariance.transpose());
}

}  // namespace point_line_odometry
