#pragma once

#include <Eigen/Core>
#include <algorithm>

namespace point_line_odometry {

/// Distance of a point from the nearest one of a line segment, whose ends must differ.
inline float distanceToSegment(const Eigen::Vector2f& start, const Eigen::Vector2f& end,
                               const Eigen::Vector2f& p) {
  const Eigen::Vector2f along = end - start;
  const float t = std::clamp((p - start).dot(along) / along.squaredNorm(), 0.0F, 1.0F);
  return (start + t * along - p).norm();
}

}  // namespace point_line_odometry
