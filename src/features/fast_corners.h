#pragma once

#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

#include "features/cell_thresholds.h"

namespace point_line_odometry {

/// A corner of the FAST test (Rosten and Drummond 2006).
struct FastCorner {
  std::int16_t x = 0;  ///< [px]
  std::int16_t y = 0;
  std::uint8_t score = 0;  ///< smallest contrast of the best arc of nine pixels
};

/// FAST corners: nine contiguous pixels of the sixteen on a circle of radius 3 are brighter or
/// darker than its centre by more than a threshold. Scores are computed by minima and maxima of
/// bytes for sixteen pixels at once, so that nothing has to be tested twice.
class FastCorners {
 public:
  static constexpr int kMinBorder = 20;  ///< pixels around a corner that are read, in blocks

  /// Corners that score higher than their eight neighbours, in reading order. \param image CV_8UC1.
  /// \param border of the image without corners [px]; at least kMinBorder. \param cells that tile
  /// the image within the border: corners that are not among the strongest of a cell may be left
  /// out, which takes less time, as the threshold of a cell rises from row to row. \param allowed
  /// CV_8UC1, 0 where no corner is wanted, or empty.
  const std::vector<FastCorner>& detect(const cv::Mat& image, int threshold, int border,
                                        const CornerCells& cells = {}, const cv::Mat& allowed = {});

 private:
  void setBlockThresholds(int cell_size_px);
  void scoreRow(const cv::Mat& image, int y, int begin);
  void collectMaxima(int y, int begin, int end, int cell_size_px, const uchar* allowed);
  std::uint8_t* scoresOf(int y) { return scores_.data() + (y % 3) * stride_; }

  std::size_t stride_ = 0;
  std::vector<std::uint8_t> scores_;            // of three rows
  std::vector<std::uint8_t> block_thresholds_;  // of one row
  std::vector<std::uint8_t> bounds_;            // of one row: the largest score of each block
  CellThresholds thresholds_;
  std::vector<FastCorner> corners_;
};

}  // namespace point_line_odometry
