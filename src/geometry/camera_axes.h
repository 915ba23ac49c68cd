#pragma once

#include <Eigen/Core>

namespace point_line_odometry {

/// Rotates a camera's axes (x right, y down, z forward) to those of the body that it is mounted on
/// (x forward, y left, z up); REP-103.
inline Eigen::Matrix3d cameraAxesInBody() {
  Eigen::Matrix3d R_body_camera;
  R_body_camera << 0.0, 0.0, 1.0, -1.0, 0.0, 0.0, 0.0, -1.0, 0.0;
  return R_body_camera;
}

}  // namespace point_line_odometry
