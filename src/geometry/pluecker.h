#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

#include "point_line_odometry/stereo_camera.h"

namespace point_line_odometry {

/// An infinite line in space: moment n = X1 x X2 and direction v = r1 X2 - r2 X1 of two homogeneous
/// points (X1, r1), (X2, r2) on it (paper, eq. 2, sign of v corrected). Scale is free.
struct PlueckerLine {
  Eigen::Vector3d n = Eigen::Vector3d::Zero();
  Eigen::Vector3d v = Eigen::Vector3d::Zero();

  /// Through two points given by homogeneous coordinates.
  static PlueckerLine throughPoints(const Eigen::Vector4d& first, const Eigen::Vector4d& second);

  /// Through two finite points [m].
  static PlueckerLine throughPoints(const Eigen::Vector3d& first, const Eigen::Vector3d& second);

  /// The same line in frame a, this one being in frame b: n_a = R n + t x R v, v_a = R v.
  PlueckerLine transformed(const Eigen::Isometry3d& T_a_b) const;
};

/// K_l of paper eq. 3 (sign corrected): the homogeneous image line of a line in the camera's frame
/// is K_l n.
Eigen::Matrix3d lineProjectionMatrix(const StereoCamera& camera);

/// Signed distance [px] of a pixel to a homogeneous image line (paper, eq. 4).
double distanceToLine(const Eigen::Vector3d& line, const Eigen::Vector2d& pixel);

}  // namespace point_line_odometry
