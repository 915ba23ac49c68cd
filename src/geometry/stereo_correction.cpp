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

}  // namespace point_line_odometry
