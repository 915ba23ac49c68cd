#pragma once

#include <Eigen/Geometry>
#include <optional>
#include <tuple>

#include "geometry/rolling_shutter.h"
#include "matching/stereo_frame.h"
#include "odometry/pose_integrator.h"
#include "point_line_odometry/parameters.h"

namespace point_line_odometry {

/// The rolling shutter (tracking/rolling_shutter_ms) of the frames, with the camera's velocity in
/// each and how well that is known; a global one where the parameter is 0.
class FrameShutter {
 public:
  FrameShutter();

  /// Before the frame's motion is known: with the last velocity (nothing: none is known), which is
  /// hardly known where it is not current. \param unmeasured_s since it was measured.
  RollingShutter predicted(const std::optional<CameraVelocity>& last, double unmeasured_s,
                           const Parameters& parameters) const;

  /// By the frame's own motion since the previous one, which took the time `dt_s`, and the velocity
  /// with which that was reached. Both are means: at the frame itself the velocity has changed by
  /// as much again as between the middles of the two times.
  RollingShutter measured(const Eigen::Isometry3d& T_curr_prev, double dt_s,
                          const std::optional<CameraVelocity>& before,
                          const Parameters& parameters) const;

  /// Learns from the next motion by how much the velocity in a frame was wrong: it is between those
  /// before and after it. \param shutter of the frame.
  void learn(const RollingShutter& shutter, const std::optional<CameraVelocity>& before,
             const Eigen::Isometry3d& T_next_frame, double dt_s);

  /// All members, for StereoOdometry::saveState().
  auto state() {
    auto& [acceleration] = *this;
    return std::tie(acceleration);
  }

 private:
  /// Running mean of the squared acceleration, along and about an axis, that would explain the
  /// errors of the velocities [m^2/s^4, rad^2/s^4].
  Eigen::Vector2d acceleration_;
};

/// By how much two shutters differ in where they show the points and lines of a frame in the left
/// image (root mean square) [px].
double rmsDifference(const RollingShutter& a, const RollingShutter& b, const StereoFrame& frame,
                     const StereoCamera& camera);

}  // namespace point_line_odometry
