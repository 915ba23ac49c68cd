#include "geometry/triangulation.h"

#include <algorithm>
#include <cmath>

namespace point_line_odometry {
namespace {

/// \param disparity_error_px of the disparity, in addition to the noise of the pixels.
TriangulatedPoint pointAt(const StereoCamera& camera, const Eigen::Vector2d& left_px,
                          double disparity_px, double sigma_px, double disparity_error_px) {
  TriangulatedPoint point;
  point.p_camera = backProject(camera, left_px, disparity_px);
  const Eigen::Matrix3d J = backProjectionJacobian(camera, point.p_camera, disparity_px);
  const double variance = sigma_px * sigma_px;
  Eigen::Matrix3d pixel_covariance = Eigen::Matrix3d::Identity() * variance;
  pixel_covariance(2, 2) = 2.0 * variance + disparity_error_px * disparity_error_px;
  pixel_covariance(0, 2) = pixel_covariance(2, 0) = variance;  // u is part of the disparity
  point.covariance = J * pixel_covariance * J.transpose();
  return point;
}

/// Parameter of the right segment at a row: 0 at its start, 1 at its end.
double parameterAtRow(const LineSegment& segment, double v) {
  return (v - segment.start.y()) / (static_cast<double>(segment.end.y()) - segment.start.y());
}

}  // namespace

Eigen::Vector3d backProject(const StereoCamera& camera, const Eigen::Vector2d& left_px,
                            double disparity_px) {
  const double z = camera.fx * camera.baseline_m / disparity_px;
  return {(left_px.x() - camera.cx) * z / camera.fx, (left_px.y() - camera.cy) * z / camera.fy, z};
}

Eigen::Matrix3d backProjectionJacobian(const StereoCamera& camera, const Eigen::Vector3d& p,
                                       double disparity_px) {
  const double z = p.z();
  Eigen::Matrix3d J;
  J << z / camera.fx, 0.0, -p.x() / disparity_px,  //
      0.0, z / camera.fy, -p.y() / disparity_px,   //
      0.0, 0.0, -z / disparity_px;
  return J;
}

std::optional<TriangulatedPoint> triangulatePoint(const StereoCamera& camera,
                                                  const Eigen::Vector2d& left_px, double right_u_px,
                                                  double sigma_px, double min_disparity_px) {
  const double disparity = left_px.x() - right_u_px;
  if (!(disparity >= min_disparity_px)) return std::nullopt;
  return pointAt(camera, left_px, disparity, sigma_px, 0.0);
}

TriangulatedPoint triangulateFarPoint(const StereoCamera& camera, const Eigen::Vector2d& left_px,
                                      double right_u_px, double sigma_px) {
  constexpr double kMinDisparityPx = 0.01;  // keeps the point finite
  const double measured = left_px.x() - right_u_px;
  const double squared = measured * measured;
  const double shrunk = measured * squared / (squared + 2.0 * sigma_px * sigma_px);
  const double disparity = std::max(shrunk, kMinDisparityPx);
  return pointAt(camera, left_px, disparity, sigma_px, disparity - measured);
}

std::optional<TriangulatedLine> triangulateLine(const StereoCamera& camera, const LineSegment& left,
                                                const LineSegment& right, double sigma_px,
                                                const LineTriangulationLimits& limits) {
  const Eigen::Vector2d along_left = left.direction().cast<double>();
  const Eigen::Vector2d along_right = right.direction().cast<double>();
  const double min_sine = std::sin(limits.min_angle_rad);
  if (!(std::abs(along_left.y()) >= min_sine && std::abs(along_right.y()) >= min_sine))
    return std::nullopt;

  // Independent noise of four end points: left start, left end, right start, right end, each along
  // its segment's normal.
  const Eigen::Vector2d normal_left(-along_left.y(), along_left.x());
  const Eigen::Vector2d normal_right(-along_right.y(), along_right.x());
  TriangulatedLine line;
  Eigen::Matrix<double, 6, 4> J = Eigen::Matrix<double, 6, 4>::Zero();
  for (const int end : {0, 1}) {
    const Eigen::Vector2d pixel = (end == 0 ? left.start : left.end).cast<double>();
    const double s = parameterAtRow(right, pixel.y());
    if (s < -limits.max_extrapolation || s > 1.0 + limits.max_extrapolation) return std::nullopt;
    const double right_u =
        right.start.x() + s * (static_cast<double>(right.end.x()) - right.start.x());
    const double disparity = pixel.x() - right_u;
    if (!(disparity >= limits.min_disparity_px && disparity <= limits.max_disparity_px))
      return std::nullopt;

    const Eigen::Vector3d p = backProject(camera, pixel, disparity);
    (end == 0 ? line.start_camera : line.end_camera) = p;
    const Eigen::Matrix3d J_pixel = backProjectionJacobian(camera, p, disparity);
    const double slope = along_right.x() / along_right.y();  // du / dv of the right line
    const double left_shift = normal_left.x() - slope * normal_left.y();
    J.block<3, 1>(3 * end, end) =
        J_pixel * Eigen::Vector3d(normal_left.x(), normal_left.y(), left_shift);
    const double right_shift =
        1.0 / normal_right.x();  // horizontal shift of the right line, per pixel along its normal
    const Eigen::Vector3d J_right = -J_pixel.col(2) * right_shift;
    J.block<3, 1>(3 * end, 2) = (1.0 - s) * J_right;
    J.block<3, 1>(3 * end, 3) = s * J_right;
  }
  line.covariance = sigma_px * sigma_px * J * J.transpose();
  return line;
}

}  // namespace point_line_odometry
