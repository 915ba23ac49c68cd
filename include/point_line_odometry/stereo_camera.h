#pragma once

#include <Eigen/Core>

namespace point_line_odometry {

/// Rectified pinhole pair: one set of intrinsics [px], the right camera at +baseline_m on the left
/// camera's x axis.
struct StereoCamera {
  double fx = 0.0;          ///< focal length in pixels along u
  double fy = 0.0;          ///< the same along v
  double cx = 0.0;          ///< principal point: u [px]
  double cy = 0.0;          ///< principal point: v [px]
  double baseline_m = 0.0;  ///< distance of the two cameras
  int width = 0;            ///< of an image [px]
  int height = 0;           ///< of an image [px]
  /// Rows of the raw left image for each of this one, in the mean, of a camera with a rolling
  /// shutter: the time of a row follows from it. Negative if rectification turns the image over; 0,
  /// thus without a time, if it turns rows into columns.
  double raw_rows = 1.0;

  /// Throws std::invalid_argument that names the first invalid field, its value and what to do.
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

  /// The same camera, to the last bit.
  bool operator==(const StereoCamera& other) const {
    return fx == other.fx && fy == other.fy && cx == other.cx && cy == other.cy &&
           baseline_m == other.baseline_m && width == other.width && height == other.height &&
           raw_rows == other.raw_rows;
  }
  /// Another camera.
  bool operator!=(const StereoCamera& other) const { return !(*this == other); }
};

}  // namespace point_line_odometry
