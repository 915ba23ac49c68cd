#include "motion/residuals.h"

#include "geometry/se3.h"

namespace point_line_odometry {

template <ResidualImages kImages>
PointResidual<kImages>::PointResidual(const PointCorrespondence& point, const StereoCamera& camera,
                                      const Eigen::Isometry3d& T_curr_prev)
    : R_(T_curr_prev.linear()), rotated_(R_ * point.p_prev), far_(point.far) {
  const Eigen::Vector3d p = rotated_ + T_curr_prev.translation();
  valid = p.z() > 1e-3 * camera.baseline_m;
  if (!valid) return;
  const double inverse_z = 1.0 / p.z();
  const double fx_z = camera.fx * inverse_z;
  const double fy_z = camera.fy * inverse_z;
  value.template head<2>() = point.left_px - camera.projectLeft(p);
  J_p_.row(0) << -fx_z, 0.0, fx_z * p.x() * inverse_z;
  J_p_.row(1) << 0.0, -fy_z, fy_z * p.y() * inverse_z;
  if constexpr (kRows == 3) {
    value(2) = point.right_px.x() - camera.projectRight(p).x();
    J_p_.row(2) << -fx_z, 0.0, fx_z * (p.x() - camera.baseline_m) * inverse_z;
  }
  value += point.offset_px.template head<kRows>();
}

template <ResidualImages kImages>
auto PointResidual<kImages>::jacobianByMotion() const -> JacobianByMotion {
  JacobianByMotion J_motion;
  J_motion.template leftCols<3>() = -J_p_ * skew(rotated_);
  if (far_) {
    J_motion.template rightCols<3>().setZero();
  } else {
    J_motion.template rightCols<3>() = J_p_;
  }
  return J_motion;
}

template <ResidualImages kImages>
LineResidual<kImages>::LineResidual(const LineCorrespondence& line, const StereoCamera& camera,
                                    const Eigen::Isometry3d& T_curr_prev)
    : R_(T_curr_prev.linear()), start_prev_(line.start_prev), end_prev_(line.end_prev) {
  const double nearest = 1e-3 * camera.baseline_m;
  if ((T_curr_prev * line.start_prev).z() < nearest || (T_curr_prev * line.end_prev).z() < nearest)
    return;
  const PlueckerLine prev = PlueckerLine::throughPoints(line.start_prev, line.end_prev);
  // Without a direction, the moment is what rounding leaves, with fused multiply-add not 0.
  if (!(prev.v.norm() > 1e-9 * line.end_prev.norm())) return;
  rotated_ = {R_ * prev.n, R_ * prev.v};
  const Eigen::Matrix3d K_l = lineProjectionMatrix(camera);
  for (int image = 0; 2 * image < kRows; ++image) {
    const Eigen::Vector3d t =
        T_curr_prev.translation() - Eigen::Vector3d(image * camera.baseline_m, 0.0, 0.0);
    const Eigen::Vector3d l = K_l * (rotated_.n + t.cross(rotated_.v));
    const double norm = l.head<2>().norm();
    if (!(norm > 1e-9 * camera.fx * rotated_.v.norm())) return;
    for (const int end : {0, 1}) {
      const Eigen::Vector2d& pixel = image == 0
                                         ? (end == 0 ? line.left_start_px : line.left_end_px)
                                         : (end == 0 ? line.right_start_px : line.right_end_px);
      const double product = l.dot(pixel.homogeneous());
      Eigen::Vector3d J_l = pixel.homogeneous() / norm;
      J_l.head<2>() -= product / (norm * norm * norm) * l.head<2>();
      const int row = 2 * image + end;
      value(row) = product / norm;
      by_column_(row) = l.x() / norm;
      J_moment_.col(row) = K_l.transpose() * J_l;
      J_moment_cross_t_.col(row) = J_moment_.col(row).cross(t);
    }
  }
  valid = true;
}

// Row vectors times cross-product matrices are cross products: a^T [b] = (a x b)^T.

template <ResidualImages kImages>
auto LineResidual<kImages>::jacobianByMotion() const -> JacobianByMotion {
  JacobianByMotion J_motion;
  for (int row = 0; row < kRows; ++row) {
    const Eigen::Vector3d J_n = J_moment_.col(row);
    const Eigen::Vector3d J_v = J_moment_cross_t_.col(row);
    J_motion.row(row) << -(J_n.cross(rotated_.n) + J_v.cross(rotated_.v)).transpose(),
        -J_n.cross(rotated_.v).transpose();
  }
  return J_motion;
}

template <ResidualImages kImages>
auto LineResidual<kImages>::jacobianByLandmark() const -> JacobianByLandmark {
  JacobianByLandmark J_landmark;
  for (int row = 0; row < kRows; ++row) {
    const Eigen::Vector3d J_n = R_.transpose() * J_moment_.col(row);
    const Eigen::Vector3d J_v = R_.transpose() * J_moment_cross_t_.col(row);
    J_landmark.row(row) << -(J_n.cross(end_prev_) + J_v).transpose(),
        (J_n.cross(start_prev_) + J_v).transpose();
  }
  return J_landmark;
}

template struct PointResidual<ResidualImages::kLeft>;
template struct PointResidual<ResidualImages::kBoth>;
template struct LineResidual<ResidualImages::kLeft>;
template struct LineResidual<ResidualImages::kBoth>;

}  // namespace point_line_odometry
