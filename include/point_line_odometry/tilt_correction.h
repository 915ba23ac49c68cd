#pragma once

#include <Eigen/Core>

namespace point_line_odometry {

/// Rotation of the last pose about horizontal axes by which it agrees with gravity.
struct TiltCorrection {
  Eigen::Vector3d up = Eigen::Vector3d::UnitZ();  ///< opposite to gravity, in odom; of length 1
  /// Rotation vector about the axes of odom, perpendicular to `up` [rad].
  Eigen::Vector3d rotation = Eigen::Vector3d::Zero();
  /// Of what remains of the pose's tilt error, about the axes of odom; nothing along `up`.
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
};

}  // namespace point_line_odometry
