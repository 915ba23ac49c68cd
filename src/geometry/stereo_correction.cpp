#include "point_line_odometry/stereo_correction.h"

namespace point_line_odometry {

StereoCorrection::Coefficients StereoCorrection::terms(const Eigen::Vector2d& right_px) const {
  const double x = scale_ * (right_px.x() - centre_.x());
  const double y = scale_ * (right_px.y() - centre_.y());
  Coefficients terms;
  terms << 1.0, x, y, x * x - 1.0 / 3.0, x * y, y * y;
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

Eigen::Vector2d StereoCorrection::rmsPx(const StereoCamera& camera) const {
  if (scale_ == 0.0) return Eigen::Vector2d::Zero();  // of no camera
  constexpr int kSide = 16;                           // of a grid of pixels
  const double scaled = 2.0 / (scale_ * camera.width);
  const Eigen::Vector2d cell_px = scaled / kSide * Eigen::Vector2d(camera.width, camera.height);
  Eigen::Vector2d squares = Eigen::Vector2d::Zero();
  for (int row = 0; row < kSide; ++row) {
    for (int column = 0; column < kSide; ++column) {
      const Coefficients t = terms({(column + 0.5) * cell_px.x(), (row + 0.5) * cell_px.y()});
      squares += Eigen::Vector2d(u.dot(t), v.dot(t)).cwiseAbs2();
    }
  }
  return (squares / (kSide * kSide)).cwiseSqrt() / scaled;
}

}  // namespace point_line_odometry
