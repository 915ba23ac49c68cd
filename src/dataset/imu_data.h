#pragma once

#include <Eigen/Geometry>
#include <vector>

#include "point_line_odometry/gyroscope.h"

namespace point_line_odometry {

/// The samples of an inertial measurement unit on the camera.
struct ImuData {
  std::vector<ImuSample> samples;
  /// Pose of the left camera (the raw one for raw images) in the IMU.
  Eigen::Isometry3d T_imu_camera = Eigen::Isometry3d::Identity();
};

}  // namespace point_line_odometry
