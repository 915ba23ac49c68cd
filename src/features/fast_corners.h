#pragma once

#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

namespace point_line_odometry {

/// A corner of the FAST test (Rosten and Drummond 2006).
struct FastCorner {
  std::int16_t x = 0;  ///< [px]
  std::int16_t y = 0;
  std::uint8_t score = 0;  ///< contrast that nine pixels in a row on the circle have at least
};

/// FAST corners: nine of the sixteen pixels on a circle of radius 3, in a row, are brighter or
/// darker than its centre by more than a threshold. The score of every pixel is computed, by minima
/// and maxima of bytes for sixteen pixels at once, so that nothing has to be tested twice.
class FastCorners {
 public:
  static constexpr int kMinBorder = 20;  ///< pixels round a block of sixteen that are read

  /// Corners that score higher than their eight neighbours, in reading order. \param image
  /// CV_8UC1. \param border of the image, in which none are looked for [px]; at least kMinBorder.
  const std::vector<FastCorner>& detect(const cv::Mat& image, int threshold, int border);

 private:
  void collectMaxima(int y, int begin, int end);
  std::uint8_t* scoresOf(int y) { return scores_.data() + (y % 3) * stride_; }

  std::size_t stride_ = 0;
  std::vector<std::uint8_t> scores_;  // of three rows
  std::vector<std::uint8_t> maxima_;  // of one row: its scores, 0 where a neighbour's is not less
  std::vector<FastCorner> corners_;
};

}  // namespace point_line_odometry
