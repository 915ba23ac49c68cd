#pragma once

#include <Eigen/Geometry>
#include <vector>

#include "point_line_odometry/wheel_odometry.h"

namespace point_line_odometry {

/// The odometry of the wheels under a camera.
struct WheelData {
  std::vector<OdometrySample> samples;
  /// Pose of the left camera (the raw one for raw images) in the body whose poses are given.
  Eigen::Isometry3d T_body_camera = Eigen::Isometry3d::Identity();
};

}  // namespace point_line_odometry
