#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <optional>
#include <tuple>

#include "odometry/pose_integrator.h"
#include "point_line_odometry/types.h"

namespace point_line_odometry {

/// The published pose. It does not jump: after a prediction, or a correction by landmarks, it
/// converges to the estimate at a limited rate. And it is constant while the estimate stays within
/// its noise of the pose at which the camera became stationary. The estimate itself is not changed:
/// a motion too slow to be detected from frame to frame accumulates in it, and ends the hold.
class PoseSmoother {
 public:
  /// Discards all state; the pose is this one.
  void reset(const Eigen::Isometry3d& T_odom_camera);

  /// After a frame whose motion was estimated, `dt_s` after the frame before.
  /// \param may_hold whether the pose is kept while the camera is stationary.
  void followMeasured(const PoseIntegrator& estimate, double dt_s, bool may_hold);

  /// After a frame whose motion was predicted. Where a prior says that the camera moves, the pose
  /// is no longer kept.
  void followPredicted(const PoseIntegrator& estimate, double dt_s);

  /// After a frame or a time whose motion is unknown: the camera may no longer be stationary.
  /// \param velocity its mean, or zero.
  void followUnknown(const PoseIntegrator& estimate, const Vector6d& velocity, double dt_s);

  /// After the estimate was moved by a correction: the pose is kept, and takes it up gradually.
  void followCorrection(const PoseIntegrator& estimate, const Eigen::Isometry3d& T_correction);

  const Eigen::Isometry3d& T_odom_camera() const { return T_odom_camera_; }

  /// True while the pose is kept for a stationary camera.
  bool holds() const { return holds_; }

  /// Whether the camera has not moved for a while, held or not.
  bool isStationary() const;

  /// Of the pose, along and about the axes of odom: that of the estimate, and the outer product of
  /// the offset from it.
  Matrix6d covariance(const PoseIntegrator& estimate) const;
  /// The second of these.
  Matrix6d offsetCovariance() const { return offset_ * offset_.transpose(); }

  /// All members, for StereoOdometry::saveState().
  auto state() {
    auto& [T, offset, holds, stationary] = *this;
    return std::tie(T, offset, holds, stationary);
  }

 private:
  /// Where the camera may have become stationary.
  struct Stationary {
    Eigen::Isometry3d T_odom_camera;  // estimated
    Matrix6d noise;                   // of the estimate relative to the previous frame
    Matrix6d steps;                   // covariance of all steps since then
    double lasted_s;

    auto state() {
      auto& [T, noise_of_this, steps_of_this, lasted] = *this;
      return std::tie(T, noise_of_this, steps_of_this, lasted);
    }
  };

  void follow(const PoseIntegrator& estimate, const Vector6d& velocity, double dt_s);
  bool updateStationary(const PoseIntegrator& estimate, double dt_s);
  bool moves(const PoseIntegrator& estimate) const;

  Eigen::Isometry3d T_odom_camera_ = Eigen::Isometry3d::Identity();
  Vector6d offset_ = Vector6d::Zero();  // from the estimate, along and about odom's axes
  bool holds_ = false;
  std::optional<Stationary> stationary_;
};

}  // namespace point_line_odometry
