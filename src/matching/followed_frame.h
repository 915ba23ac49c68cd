#pragma once

#include <Eigen/Core>
#include <opencv2/core.hpp>
#include <vector>

namespace point_line_odometry {

/// A point of a rectified left image.
struct FollowedPoint {
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();
  bool matched = false;  ///< in the right image: then the next two are known
  double disparity = 0.0;
  double vertical_disparity = 0.0;
  int next = -1;  ///< index in the next frame; then the flow is known
  Eigen::Vector2d flow = Eigen::Vector2d::Zero();  ///< to there [px]

  bool followed() const { return matched && next >= 0; }
};

/// The points of a pair, as followed to the next one.
struct FollowedFrame {
  cv::Size size;
  std::vector<FollowedPoint> points;
  double period_s = 0.0;  ///< to the next frame; 0: none follows
};

}  // namespace point_line_odometry
