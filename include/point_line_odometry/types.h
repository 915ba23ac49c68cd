#pragma once

/// \file
/// Conventions of this package, and the small types that all stages share.
///
/// Frames. `T_a_b` maps coordinates in frame b to frame a: `p_a = T_a_b * p_b`. A camera frame has
/// x right, y down, z forward (REP-103 optical); "camera" without more is the *rectified left*
/// camera. `prev` and `curr` are the cameras of stereo frames k-1 and k; `odom` is the frame in
/// which the pose is integrated.
///
/// Pixels. `(u, v)` with u to the right and v down; (0, 0) is the centre of the top-left pixel. In
/// the rectified pair a feature has the same v in both images and disparity `d = u_left - u_right >
/// 0`.
///
/// Units are suffixes of names: `_px`, `_m`, `_s`, `_ns`, `_ms`, `_rad`, `_deg`. Covariances of a
/// motion or pose are 6 x 6 in ROS' order: translation x y z [m], then rotation about x y z [rad].

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstdint>
#include <opencv2/core/mat.hpp>

namespace point_line_odometry {

/// Translation or linear velocity, then rotation or angular velocity.
using Vector6d = Eigen::Matrix<double, 6, 1>;
/// Covariance of a Vector6d.
using Matrix6d = Eigen::Matrix<double, 6, 6>;

/// A straight edge. It is directed: seen from start to end, the brighter side is on the right in
/// the image (x right, y down), so that the same edge has the same direction in every image.
struct LineSegment {
  Eigen::Vector2f start = Eigen::Vector2f::Zero();  ///< [px]
  Eigen::Vector2f end = Eigen::Vector2f::Zero();    ///< [px]

  /// From start to end, of unit length.
  Eigen::Vector2f direction() const { return (end - start).normalized(); }
  /// [px]
  Eigen::Vector2f middle() const { return 0.5F * (start + end); }
  /// [px]
  float length() const { return (end - start).norm(); }
};

/// One synchronised, rectified pair of images: both CV_8UC1 and of the camera's size. Each may have
/// a mask of the same type and size: pixels where it is 0 are ignored, as if the image ended there.
struct StereoImages {
  cv::Mat left;               ///< CV_8UC1
  cv::Mat right;              ///< CV_8UC1
  std::int64_t stamp_ns = 0;  ///< when both were taken, from any epoch
  cv::Mat left_mask = {};     ///< empty: no pixel is ignored
  cv::Mat right_mask = {};    ///< the same for the right image
};

/// A difference of stamps in seconds.
inline double toSeconds(std::int64_t span_ns) { return 1e-9 * static_cast<double>(span_ns); }

}  // namespace point_line_odometry
