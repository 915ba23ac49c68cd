#include "motion/residuals.h"

#include <cmath>

#include "geometry/skew.h"

namespace point_line_odometry {
namespace {

/// Left Jacobian of the rotation: exp(w + dw) = exp(J dw) exp(w).
Eigen::Matrix3d leftJacobian(const Eigen::Vector3d& w) {
  const double angle = w.norm();
  const Eigen::Matrix3d W = skew(w);
  if (angle < 1e-6) return Eigen::Matrix3d::Identity() + 0.5 * W;
  const double a2 = angle * angle;
  return Eigen::Matrix3d::Identity() + (1.0 - std::cos(angle)) / a2 * W +
         (angle - std::sin(angle)) / (a2 * angle) * W * W;
}

constexpr ResidualImages imagesOf(int rows) {
  return rows > 2 ? ResidualImages::kBoth : ResidualImages::kLeft;
}

}  // namespace

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

PointResidual::PointResidual(const PointCorrespondence& point, const StereoCamera& camera,
                             const Eigen::Isometry3d& T_curr_prev, ResidualImages images) {
  const int rows = images == ResidualImages::kBoth ? 3 : 2;
  const Eigen::Vector3d rotated = T_curr_prev.linear() * point.p_prev;
  const Eigen::Vector3d p = rotated + T_curr_prev.translation();
  valid = p.z() > 1e-3 * camera.baseline_m;
  if (!valid) return;

  const double inverse_z = 1.0 / p.z();
  Eigen::Matrix<double, Eigen::Dynamic, 3, 0, kMaxRows, 3> by_p(rows, 3);
  value.resize(rows);
  value.head<2>() = point.left_px - camera.projectLeft(p);
  by_p.row(0) << -camera.fx * inverse_z, 0.0, camera.fx * p.x() * inverse_z * inverse_z;
  by_p.row(1) << 0.0, -camera.fy * inverse_z, camera.fy * p.y() * inverse_z * inverse_z;
  if (rows == 3) {
    value(2) = point.right_px.x() - camera.projectRight(p).x();
    by_p.row(2) << -camera.fx * inverse_z, 0.0,
        camera.fx * (p.x() - camera.baseline_m) * inverse_z * inverse_z;
  }
  by_motion.resize(rows, 6);
  by_motion.leftCols<3>() = -by_p * skew(rotated);
  by_motion.rightCols<3>() = by_p;
  by_point = by_p * T_curr_prev.linear();
}

LineResidual::LineResidual(const LineCorrespondence& line, const StereoCamera& camera,
                           const Eigen::Isometry3d& T_curr_prev, ResidualImages images) {
  const int rows = images == ResidualImages::kBoth ? 4 : 2;
  const Eigen::Matrix3d& R = T_curr_prev.linear();
  const PlueckerLine prev = PlueckerLine::throughPoints(line.start_prev, line.end_prev);
  const Eigen::Vector3d n = R * prev.n;
  const Eigen::Vector3d v = R * prev.v;
  const double nearest = 1e-3 * camera.baseline_m;
  if ((T_curr_prev * line.start_prev).z() < nearest || (T_curr_prev * line.end_prev).z() < nearest)
    return;

  value.resize(rows);
  by_motion.resize(rows, 6);
  by_end_points.resize(rows, 6);
  const Eigen::Matrix3d K_l = lineProjectionMatrix(camera);
  for (int image = 0; 2 * image < rows; ++image) {
    const Eigen::Vector3d t =
        T_curr_prev.translation() - Eigen::Vector3d(image * camera.baseline_m, 0.0, 0.0);
    const Eigen::Vector3d l = K_l * (n + t.cross(v));
    const double norm = l.head<2>().norm();
    if (!(norm > 1e-9 * camera.fx * v.norm())) return;

    // The image line by the rotation, the translation and the end points.
    Eigen::Matrix<double, 3, 6> l_by_motion;
    l_by_motion.leftCols<3>() = -K_l * (skew(n) + skew(t) * skew(v));
    l_by_motion.rightCols<3>() = -K_l * skew(v);
    Eigen::Matrix<double, 3, 6> l_by_ends;
    l_by_ends.leftCols<3>() = K_l * (-R * skew(line.end_prev) - skew(t) * R);
    l_by_ends.rightCols<3>() = K_l * (R * skew(line.start_prev) + skew(t) * R);
    for (const int end : {0, 1}) {
      const Eigen::Vector2d& pixel = image == 0
                                         ? (end == 0 ? line.left_start_px : line.left_end_px)
                                         : (end == 0 ? line.right_start_px : line.right_end_px);
      const double product = l.dot(pixel.homogeneous());
      Eigen::RowVector3d by_l = pixel.homogeneous().transpose() / norm;
      by_l.head<2>() -= product / (norm * norm * norm) * l.head<2>().transpose();
      const int row = 2 * image + end;
      value(row) = product / norm;
      by_motion.row(row) = by_l * l_by_motion;
      by_end_points.row(row) = by_l * l_by_ends;
    }
  }
  valid = true;
}

template <typename Correspondence, typename Residual, int kRows>
bool WeightedCost<Correspondence, Residual, kRows>::Evaluate(double const* const* parameters,
                                                             double* residuals,
                                                             double** jacobians) const {
  const MotionVector motion{Eigen::Map<const Eigen::Vector3d>(parameters[0]),
                            Eigen::Map<const Eigen::Vector3d>(parameters[1])};
  const Residual residual(correspondence_, camera_, motion.toIsometry(), imagesOf(kRows));
  if (!residual.valid) return false;
  Eigen::Map<Eigen::Matrix<double, kRows, 1>> r(residuals);
  r = sqrt_information_ * residual.value;
  if (jacobians == nullptr) return true;
  using Jacobian = Eigen::Matrix<double, kRows, 3, Eigen::RowMajor>;
  if (jacobians[0] != nullptr) {
    Eigen::Map<Jacobian> by_rotation(jacobians[0]);
    by_rotation = sqrt_information_ * residual.by_motion.template leftCols<3>() *
                  leftJacobian(motion.rotation);
  }
  if (jacobians[1] != nullptr) {
    Eigen::Map<Jacobian> by_translation(jacobians[1]);
    by_translation = sqrt_information_ * residual.by_motion.template rightCols<3>();
  }
  return true;
}

template class WeightedCost<PointCorrespondence, PointResidual, 2>;
template class WeightedCost<PointCorrespondence, PointResidual, 3>;
template class WeightedCost<LineCorrespondence, LineResidual, 2>;
template class WeightedCost<LineCorrespondence, LineResidual, 4>;

}  // namespace point_line_odometry
