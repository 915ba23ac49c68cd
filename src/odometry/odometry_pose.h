#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <optional>
#include <tuple>

#include "odometry/pose_integrator.h"
#include "odometry/pose_smoother.h"
#include "odometry/tracking_result.h"
#include "point_line_odometry/frame_result.h"
#include "point_line_odometry/parameters.h"
#include "point_line_odometry/tilt_correction.h"
#include "point_line_odometry/types.h"

namespace point_line_odometry {

/// Poses of a map and of its previous frame in odom, from which tracking continues when the camera
/// is relocalized in the map.
struct MapAnchor {
  Eigen::Isometry3d T_odom_map = Eigen::Isometry3d::Identity();
  Eigen::Isometry3d T_odom_previous = Eigen::Isometry3d::Identity();
  Matrix6d previous_covariance = Matrix6d::Zero();  ///< of T_odom_previous, along odom's axes

  auto state() {
    auto& [map, previous, covariance] = *this;
    return std::tie(map, previous, covariance);
  }
};

/// The pose of the camera in odom, from the estimate to what is published:
///
///     odom --T_odom_map--> map --T_map_previous--> previous frame --motion--> camera
///      |                    (moves with each bundle adjustment)
///      +-----T_odom_previous---------------------> previous frame --step----> camera
///      |                                                               = T_odom_estimate
///      +-----T_odom_camera = offset * T_odom_estimate-----------------------> camera, as published
///
/// The upper chain follows the landmarks and may be corrected by the window; `step` follows it no
/// further than the errors of a motion from frame to frame explain, so that T_odom_estimate
/// (PoseIntegrator) has no jump by a correction. Where a motion is estimated again after a
/// prediction, or the camera is relocalized, T_odom_estimate jumps; the published pose
/// (PoseSmoother) takes the offset up gradually, and is constant for a stationary camera.
class OdometryPose {
 public:
  OdometryPose() = default;

  /// \param T_odom_camera the pose of the first frame, known exactly.
  explicit OdometryPose(const Eigen::Isometry3d& T_odom_camera);

  /// The next frame is the first one of a new map, at this pose; see PoseIntegrator::continueAt().
  void continueAt(const Eigen::Isometry3d& T_odom_camera);

  /// Updates the pose by the tracking result of a frame, `dt_s` after the frame before (0: it is
  /// the very first); without a motion as predict() does. Returns how far the pose can be trusted.
  TrackingState update(const TrackingResult& tracked, const FrameHistory& history,
                       const FrameContext& context, double dt_s, const MotionPrior* prior);

  /// Predicts the pose from the last velocity and a prior of the motion since the last frame (null:
  /// none), as long as a prediction may last.
  TrackingState predict(double dt_s, const TrackingParameters& parameters,
                        const MotionPrior* prior);

  /// Turns the estimate about the camera; the published pose takes it up gradually.
  void correctTilt(const TiltCorrection& correction);

  /// The current frame becomes the previous one.
  void advance() { integrator_.advance(); }

  /// A new map begins at the last pose, or at that of the previous frame.
  void startMap() { T_odom_map_ = integrator_.T_odom_camera(); }
  void startMapAtPrevious() { T_odom_map_ = integrator_.T_odom_previous(); }

  /// Anchor of the current map and previous frame.
  MapAnchor anchor() const;
  void returnTo(const MapAnchor& anchor);

  /// Whether the camera can be at a pose in its next frame: within six standard deviations of the
  /// prediction.
  bool isReachable(const Eigen::Isometry3d& T_odom_camera, double dt_s,
                   const TrackingParameters& parameters) const;

  /// The last estimate, current or not; nothing before two frames were matched.
  const std::optional<CameraVelocity>& velocity() const { return integrator_.velocity(); }
  void loseVelocity() { integrator_.loseVelocity(); }

  /// Whether the camera has not moved for a while.
  bool isStationary() const { return smoother_.isStationary(); }

  /// The same as the next frame may use it to predict pixels: not current either after a gap, or if
  /// motions have been predicted for longer than the velocity alone may predict them.
  /// \param stamp_ns of the next frame.
  std::optional<CameraVelocity> velocityFor(std::int64_t stamp_ns,
                                            const TrackingParameters& parameters) const;

  /// Fills in poses, velocity and their covariances.
  void report(TrackingState tracking, const TrackingParameters& parameters,
              FrameResult* result) const;

  /// All members, for StereoOdometry::saveState().
  auto state() {
    auto& [T_odom_map, integrator, smoother] = *this;
    return std::tie(T_odom_map, integrator, smoother);
  }

 private:
  MotionStep stepOf(const TrackingResult& tracked, const std::optional<LocalMap>& map) const;

  Eigen::Isometry3d T_odom_map_ = Eigen::Isometry3d::Identity();
  PoseIntegrator integrator_;  // T_odom_previous, T_odom_estimate
  PoseSmoother smoother_;      // T_odom_camera
};

}  // namespace point_line_odometry
