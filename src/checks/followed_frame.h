#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cstddef>
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

/// The index, row by row, of the part of the image that a pixel lies in, of columns x rows parts.
inline std::size_t cellOf(const Eigen::Vector2d& pixel, const cv::Size& size, int columns,
                          int rows) {
  const auto part = [](double value, int size, int parts) {
    return std::clamp(static_cast<int>(value * parts / size), 0, parts - 1);
  };
  const int column = part(pixel.x(), size.width, columns);
  const int row = part(pixel.y(), size.height, rows);
  return static_cast<std::size_t>(row * columns + column);
}

/// Parts of the image in which errors of calibration and matching are alike: each is a cluster of
/// the variance of a measurement.
inline constexpr int kClusterColumns = 6;
inline constexpr int kClusterRows = 4;
inline constexpr int kClusters = kClusterColumns * kClusterRows;

/// The index of the one that a pixel lies in.
inline std::size_t clusterOf(const Eigen::Vector2d& pixel, const cv::Size& size) {
  return cellOf(pixel, size, kClusterColumns, kClusterRows);
}

}  // namespace point_line_odometry
