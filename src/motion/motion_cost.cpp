#include "motion/motion_cost.h"

#include <cmath>

namespace point_line_odometry {

MotionVector MotionVector::from(const Eigen::Isometry3d& T_curr_prev) {
  const Eigen::AngleAxisd angle_axis(T_curr_prev.linear());
  return {angle_axis.angle() * angle_axis.axis(), T_curr_prev.translation()};
}

Eigen::Isometry3d MotionVector::toIsometry() const {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  const double angle = rotation.norm();
  if (angle > 0.0) T.linear() = Eigen::AngleAxisd(angle, rotation / angle).toRotationMatrix();
  T.translation() = translation;
  return T;
}

Eigen::Matrix3d leftJacobian(const Eigen::Vector3d& w) {
  const double angle = w.norm();
  const Eigen::Matrix3d W = skew(w);
  if (angle < 1e-6) return Eigen::Matrix3d::Identity() + 0.5 * W;
  const double a2 = angle * angle;
  return Eigen::Matrix3d::Identity() + (1.0 - std::cos(angle)) / a2 * W +
         (angle - std::sin(angle)) / (a2 * angle) * W * W;
}

HuberScale::HuberScale(double squared_norm, double delta) {
  if (!(squared_norm > delta * delta)) return;
  // Huber's function of the norm n beyond delta is rho = 2 delta n - delta^2; g = sqrt(rho) / n.
  const double norm = std::sqrt(squared_norm);
  const double rho = 2.0 * delta * norm - delta * delta;
  scale = std::sqrt(rho) / norm;
  twice_derivative = (delta * norm - rho) / (scale * squared_norm * squared_norm);
}

}  // namespace point_line_odometry
