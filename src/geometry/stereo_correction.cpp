#include "point_line_odometry/stereo_correction.h"

namespace point_line_odometry {

StereoCorrection::Coefficients StereoCorrection::terms(const Eigen::Vector2d& right_px) const {
  const double x = scale_ * (right_px.x() - centre_.x());
  const double y = scale_ * (right_px.y() - centre_.y());
  Coefficients terms;
  terms << 1.0, x, y, x * x - 1.0 / 3.0, x * y, y * y, x * x * x * x;
  return terms;
}

Eigen::Vector2d StereoCorrection::apply(const Eigen::Vector2d& right_px) const {
  const Coefficients t = terms(right_px);
  return {right_px.x() - u.dot(t), right_px.y() - v.dot(t)};
}

LineSegment StereoCorrection::apply(const LineSegment& right) const {
  return {apply(right.start.cast<double>()).cast<float>(),
          apply(right.end.cast<double>()).cast<float>()};
}

Eigen::Matrix2Xd StereoCorrection::displacements(const StereoCamera& camera) const {
  constexpr int kSide = 16;  // of the grid
  Eigen::Matrix2Xd displacements = Eigen::Matrix2Xd::Zero(2, kSide * kSide);
  if (scale_ == 0.0) return displacements;  // of no camera
  const double scaled = 2.0 / (scale_ * camera.width);
  const Eigen::Vector2d cell_px = scaled / kSide * Eigen::Vector2d(camera.width, camera.height);
  for (int row = 0; row < kSide; ++row) {
    for (int column = 0; column < kSide; ++column) {
      const Coefficients t = terms({(column + 0.5) * cell_px.x(), (row + 0.5) * cell_px.y()});
      displacements.col(row * kSide + column) << u.dot(t) / scaled, v.dot(t) / scaled;
    }
  }
  return displacements;
}

Eigen::Vector2d StereoCorrection::meanPx(const StereoCamera& camera) const {
  return displacements(camera).rowwise().mean();
}

Eigen::Vector2d StereoCorrection::rmsPx(const StereoCamera& camera) const {
  return displacements(camera).cwiseAbs2().rowwise().mean().cwiseSqrt();
}

}  // namespace point_line_odometry
