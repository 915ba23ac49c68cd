#pragma once

#include <Eigen/Geometry>

#include "features/features.h"
#include "geometry/rolling_shutter.h"

namespace point_line_odometry {

/// Predicted motion from frame k-1 to frame k, and the search radius around predicted features.
struct MotionPrediction {
  Eigen::Isometry3d T_curr_prev = Eigen::Isometry3d::Identity();
  double radius_px = 25.0;
  RollingShutter shutter = {};  ///< of frame k
};

/// A known point, predicted in both images of frame k.
struct ExpectedPoint {
  Eigen::Vector2f left_px = Eigen::Vector2f::Zero();
  Eigen::Vector2f right_px = Eigen::Vector2f::Zero();
  Descriptor left_descriptor{};
  Descriptor right_descriptor{};
};

/// The same for a line.
struct ExpectedLine {
  LineSegment left;
  LineSegment right;
  Descriptor left_descriptor{};
  Descriptor right_descriptor{};
};

}  // namespace point_line_odometry
