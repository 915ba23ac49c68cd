#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <optional>
#include <tuple>

#include "point_line_odometry/pose_integrator.h"
#include "point_line_odometry/types.h"

namespace point_line_odometry {

/// What is published of the estimated pose. It does not jump: where a measurement ends a
/// prediction, or landmarks correct the pose, it takes that up no faster than a controller can
/// stand. And it stands exactly still while the estimate stays within its noise round the place
/// where the camera came to rest. The estimate itself is not touched: a motion too slow to be seen
/// from frame to frame adds up in it, and ends the hold.
class SteadyPose {
 public:
  /// Forgets the past; the pose is this one.
  void reset(const Eigen::Isometry3d& T_odom_camera);

  /// After a frame whose motion was measured, `dt_s` after the frame before.
  /// \param may_hold whether the pose is to stand still with the camera.
  void followMeasured(const PoseIntegrator& estimate, double dt_s, bool may_hold);

  /// After a frame whose motion was predicted.
  void followPredicted(const PoseIntegrator& estimate, double dt_s);

  /// After a frame that says nothing of the motion: the camera may stand no more.
  void followUnknown(const PoseIntegrator& estimate, double dt_s);

  const Eigen::Isometry3d& T_odom_camera() const { return T_odom_camera_; }

  /// True while the camera stands.
  bool holds() const { return holds_; }

  /// Of the pose, along and about the axes of odom: that of the estimate, and the way to it.
  Matrix6d covariance(const PoseIntegrator& estimate) const;

  /// All members, for StereoOdometry::saveState().
  auto state() {
    auto& [T, offset, holds, rest] = *this;
    return std::tie(T, offset, holds, rest);
  }

 private:
  /// Where the camera may have come to rest.
  struct Rest {
    Eigen::Isometry3d T_odom_camera;  // estimated
    Matrix6d noise;                   // of the estimate against its reference
    Matrix6d reference_covariance;
    double lasted_s;

    auto state() {
      auto& [T, noise_of_this, covariance, lasted] = *this;
      return std::tie(T, noise_of_this, covariance, lasted);
    }
  };

  void follow(const PoseIntegrator& estimate, const Vector6d& velocity, double dt_s);
  bool watchRest(const PoseIntegrator& estimate, double dt_s);

  Eigen::Isometry3d T_odom_camera_ = Eigen::Isometry3d::Identity();
  Vector6d offset_ = Vector6d::Zero();  // of it from the estimate, along and about odom's axes
  bool holds_ = false;
  std::optional<Rest> rest_;
};

}  // namespace point_line_odometry
