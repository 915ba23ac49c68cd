#pragma once

/// \file
/// Conventions of this package, and the small types every stage shares.
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
#include <array>
#include <cstdint>
#include <opencv2/core/mat.hpp>

namespace point_line_odometry {

using Vector6d = Eigen::Matrix<double, 6, 1>;
using Matrix6d = Eigen::Matrix<double, 6, 6>;

/// 256-bit binary descriptor, of points (rotated BRIEF) and of lines (LBD) alike.
using Descriptor = std::array<std::uint64_t, 4>;

/// One synchronised, rectified pair of images: both CV_8UC1 and of the size that the camera says.
struct StereoImages {
  cv::Mat left;
  cv::Mat right;
  std::int64_t stamp_ns = 0;
};

/// A difference of stamps in seconds.
inline double toSeconds(std::int64_t span_ns) { return 1e-9 * static_cast<double>(span_ns); }

}  // namespace point_line_odometry
