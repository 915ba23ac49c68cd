#pragma once

#include <opencv2/core.hpp>

namespace point_line_odometry {

/// How the two images of a stereo pair lie to each other, measured without their calibration. Right
/// minus left for rows, left minus right for columns, as disparities are.
struct PairMeasurement {
  static constexpr int kFewestMatches = 25;  ///< fewer say nothing

  int corners_left = 0;
  int corners_right = 0;
  double contrast_left = 0.0;  ///< standard deviation of the brightness [grey levels]
  double contrast_right = 0.0;
  int matches = 0;  ///< pairs of points that agree with each other; what follows is of them

  double row_offset_px = 0.0;          ///< median of the row differences: how far right lies lower
  double row_distance_px = 0.0;        ///< median of their amounts: also large if right is turned
  double disparity_px = 0.0;           ///< median
  double behind_infinity_share = 0.0;  ///< of the disparities, those clearly below 0

  bool identical = false;  ///< both images are the same, byte for byte, and not of one colour

  bool valid() const { return matches >= kFewestMatches; }
};

/// Matches points of two images that may be badly rectified, turned or exchanged: in all columns
/// and within a sixth of the height, in both directions. Row differences of true pairs change
/// smoothly over the image; pairs that do not fit in are left out. Takes about as long as a frame
/// of the odometry. \param left,right CV_8UC1 of any size; anything else gives no matches.
PairMeasurement measurePair(const cv::Mat& left, const cv::Mat& right);

}  // namespace point_line_odometry
