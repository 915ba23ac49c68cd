#pragma once

#include <Eigen/Core>

#include "point_line_odometry/types.h"

namespace point_line_odometry {

/// Rectified pinhole pair: one set of intrinsics [px], the right camera at +baseline_m on the left
/// camera's x axis.
struct StereoCamera {
  double fx = 0.0;
  double fy = 0.0;
  double cx = 0.0;
  double cy = 0.0;
  double baseline_m = 0.0;
  int width = 0;
  int height = 0;

  /// Throws std::invalid_argument that names the first field that cannot be right, its value and
  /// the cure.
  void validate() const;

  /// Pixel of a point in the left camera's frame [m]; the point must be in front of the camera (z >
  /// 0).
  Eigen::Vector2d projectLeft(const Eigen::Vector3d& p_camera) const {
    return {fx * p_camera.x() / p_camera.z() + cx, fy * p_camera.y() / p_camera.z() + cy};
  }

  /// Pixel in the right image of a point in the *left* camera's frame [m].
  Eigen::Vector2d projectRight(const Eigen::Vector3d& p_camera) const {
    return {fx * (p_camera.x() - baseline_m) / p_camera.z() + cx,
            fy * p_camera.y() / p_camera.z() + cy};
  }

  bool operator==(const StereoCamera& other) const {
    return fx == other.fx && fy == other.fy && cx == other.cx && cy == other.cy &&
           baseline_m == other.baseline_m && width == other.width && height == other.height;
  }
  bool operator!=(const StereoCamera& other) const { return !(*this == other); }
};

}  // namespace point_line_odometry
