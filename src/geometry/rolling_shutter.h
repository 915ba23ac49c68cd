#pragma once

#include <Eigen/Core>
#include <tuple>
#include <utility>

#include "point_line_odometry/stereo_camera.h"
#include "point_line_odometry/types.h"

namespace point_line_odometry {

/// A point in the left image of a rectified pair, and its disparity; both [px].
struct PixelWithDisparity {
  Eigen::Vector2d left_px = Eigen::Vector2d::Zero();
  double disparity_px = 0.0;
};

/// A rolling shutter exposes the rows of both images one after the other, the middle one at the
/// stamp: by then the camera has moved on, at a velocity that is constant while an image is read
/// out. Rows of the raw image are those of the rectified one times StereoCamera::raw_rows.
class RollingShutter {
 public:
  /// A global shutter, which changes nothing.
  RollingShutter() = default;

  /// \param read_out_s time from the first row to the last one; negative: the last one comes first.
  /// \param velocity of the camera in its own axes, linear [m/s] and angular [rad/s].
  /// \param variances of its error. \param is_measured whether it is from the frame's own motion.
  RollingShutter(double read_out_s, Vector6d velocity, Vector6d variances, bool is_measured)
      : read_out_s_(read_out_s),
        velocity_(std::move(velocity)),
        variances_(std::move(variances)),
        is_measured_(is_measured) {}

  bool isGlobal() const { return read_out_s_ == 0.0; }
  /// Whether the velocity is from the frame's own motion; else it is predicted, or not known.
  bool isMeasured() const { return is_measured_; }
  /// The same, whose velocity is not from the frame's own motion after all.
  RollingShutter notMeasured() const { return {read_out_s_, velocity_, variances_, false}; }
  const Vector6d& velocity() const { return velocity_; }
  const Vector6d& variances() const { return variances_; }

  /// When a row of the left or right image is exposed, since the stamp [s]; a row beyond the image
  /// as its first or last one.
  double timeOf(const StereoCamera& camera, double row) const;

  /// Where the cameras would have seen at the stamp what they have seen. The disparity may be 0 or
  /// negative, as that of far points is.
  PixelWithDisparity atStamp(const StereoCamera& camera, const PixelWithDisparity& exposed) const;

  /// A point in the left camera at the stamp, in that camera as the point's row is exposed [m]. One
  /// that is not in front of the camera remains where it is.
  Eigen::Vector3d whenExposed(const StereoCamera& camera, const Eigen::Vector3d& p_camera) const;

  /// All members, for StereoOdometry::saveState().
  auto state() {
    auto& [read_out_s, velocity, variances, is_measured] = *this;
    return std::tie(read_out_s, velocity, variances, is_measured);
  }

 private:
  double read_out_s_ = 0.0;
  Vector6d velocity_ = Vector6d::Zero();
  Vector6d variances_ = Vector6d::Zero();
  bool is_measured_ = false;
};

}  // namespace point_line_odometry
