#pragma once

#include <Eigen/Geometry>
#include <optional>

#include "point_line_odometry/stereo_camera.h"

namespace point_line_odometry {

/// How far one pixel to the right and one down in an image leads on a surface that faces the camera
/// at a depth: columns in that camera's frame [m].
inline Eigen::Matrix<double, 3, 2> facingPixelAxes(const StereoCamera& camera, double depth_m) {
  Eigen::Matrix<double, 3, 2> axes = Eigen::Matrix<double, 3, 2>::Zero();
  axes(0, 0) = depth_m / camera.fx;
  axes(1, 1) = depth_m / camera.fy;
  return axes;
}

/// How the image of a small surface changes: pixels of the image in which it was first seen, per
/// pixel of this camera's left image. \param p_camera its place, in front of this camera.
/// \param axes where one pixel of the first image leads on it, in this camera's frame. Nothing if
/// it looks so much smaller or larger that the two cannot be compared.
inline std::optional<Eigen::Matrix2f> patchWarp(const StereoCamera& camera,
                                                const Eigen::Vector3d& p_camera,
                                                const Eigen::Matrix<double, 3, 2>& axes) {
  constexpr double kMinGrowth = 0.4;  // of the area
  constexpr double kMaxGrowth = 3.0;
  const double inverse_z = 1.0 / p_camera.z();
  Eigen::Matrix<double, 2, 3> projection;
  projection << camera.fx, 0.0, -camera.fx * p_camera.x() * inverse_z,  //
      0.0, camera.fy, -camera.fy * p_camera.y() * inverse_z;
  const Eigen::Matrix2d image_by_patch = inverse_z * projection * axes;
  const double growth = image_by_patch.determinant();
  if (!(growth >= kMinGrowth && growth <= kMaxGrowth)) return std::nullopt;
  return Eigen::Matrix2f(image_by_patch.inverse().cast<float>());
}

}  // namespace point_line_odometry
