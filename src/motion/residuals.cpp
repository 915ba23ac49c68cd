#include "motion/residuals.h"

#include "geometry/skew.h"

namespace point_line_odometry {

template <ResidualImages kImages>
PointResidual<kImages>::PointResidual(const PointCorrespondence& point, const StereoCamera& camera,
                                      const Eigen::Isometry3d& T_curr_prev) {
  const Eigen::Vector3d rotated = T_curr_prev.linear() * point.p_prev;
  const Eigen::Vector3d p = rotated + T_curr_prev.translation();
  valid = p.z() > 1e-3 * camera.baseline_m;
  if (!valid) return;

  const double inverse_z = 1.0 / p.z();
  const double fx_z = camera.fx * inverse_z;
  const double fy_z = camera.fy * inverse_z;
  Eigen::Matrix<double, kRows, 3> by_p;
  value.template head<2>() = point.left_px - camera.projectLeft(p);
  by_p.row(0) << -fx_z, 0.0, fx_z * p.x() * inverse_z;
  by_p.row(1) << 0.0, -fy_z, fy_z * p.y() * inverse_z;
  if constexpr (kRows == 3) {
    value(2) = point.right_px.x() - camera.projectRight(p).x();
    by_p.row(2) << -fx_z, 0.0, fx_z * (p.x() - camera.baseline_m) * inverse_z;
  }
  by_motion.template leftCols<3>() = -by_p * skew(rotated);
  by_motion.template rightCols<3>() = by_p;
  by_landmark = by_p * T_curr_prev.linear();
}

template <ResidualImages kImages>
LineResidual<kImages>::LineResidual(const LineCorrespondence& line, const StereoCamera& camera,
                                    const Eigen::Isometry3d& T_curr_prev) {
  const Eigen::Matrix3d R = T_curr_prev.linear();
  const PlueckerLine prev = PlueckerLine::throughPoints(line.start_prev, line.end_prev);
  const Eigen::Vector3d n = R * prev.n;
  const Eigen::Vector3d v = R * prev.v;
  const double nearest = 1e-3 * camera.baseline_m;
  if ((T_curr_prev * line.start_prev).z() < nearest || (T_curr_prev * line.end_prev).z() < nearest)
    return;

  const Eigen::Matrix3d K_l = lineProjectionMatrix(camera);
  for (int image = 0; 2 * image < kRows; ++image) {
    const Eigen::Vector3d t =
        T_curr_prev.translation() - Eigen::Vector3d(image * camera.baseline_m, 0.0, 0.0);
    const Eigen::Vector3d l = K_l * (n + t.cross(v));
    const double norm = l.head<2>().norm();
    if (!(norm > 1e-9 * camera.fx * v.norm())) return;

    for (const int end : {0, 1}) {
      const Eigen::Vector2d& pixel = image == 0
                                         ? (end == 0 ? line.left_start_px : line.left_end_px)
                                         : (end == 0 ? line.right_start_px : line.right_end_px);
      const double product = l.dot(pixel.homogeneous());
      Eigen::Vector3d by_l = pixel.homogeneous() / norm;
      by_l.head<2>() -= product / (norm * norm * norm) * l.head<2>();
      // The image line is K_l m, m = n + t x v: row vectors times cross-product matrices are cross
      // products.
      const Eigen::Vector3d by_m = K_l.transpose() * by_l;
      const Eigen::Vector3d by_m_cross_t = by_m.cross(t);
      const int row = 2 * image + end;
      value(row) = product / norm;
      by_motion.row(row).template head<3>() = -(by_m.cross(n) + by_m_cross_t.cross(v));
      by_motion.row(row).template tail<3>() = -by_m.cross(v);
      const Eigen::Vector3d by_n = R.transpose() * by_m;
      const Eigen::Vector3d by_v = R.transpose() * by_m_cross_t;
      by_landmark.row(row).template head<3>() = -by_n.cross(line.end_prev) - by_v;
      by_landmark.row(row).template tail<3>() = by_n.cross(line.start_prev) + by_v;
    }
  }
  valid = true;
}

template struct PointResidual<ResidualImages::kLeft>;
template struct PointResidual<ResidualImages::kBoth>;
template struct LineResidual<ResidualImages::kLeft>;
template struct LineResidual<ResidualImages::kBoth>;

}  // namespace point_line_odometry
