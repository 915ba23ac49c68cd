#pragma once

#include <opencv2/core.hpp>

namespace point_line_odometry {

/// Geometry of a stereo pair measured from its matches, without the calibration. Vertical
/// disparities are right minus left, horizontal ones left minus right.
struct PairMeasurement {
  static constexpr int kFewestMatches = 25;  ///< fewer are inconclusive

  int keypoints_left = 0;
  int keypoints_right = 0;
  double contrast_left = 0.0;  ///< standard deviation of the brightness [grey levels]
  double contrast_right = 0.0;
  int matches = 0;  ///< consistent pairs of points; the members below are of them

  double row_offset_px = 0.0;          ///< median of the vertical disparities: right is lower
  double vertical_disparity_px = 0.0;  ///< median of their amounts: large also if right is rotated
  double disparity_px = 0.0;           ///< median
  double behind_infinity_share = 0.0;  ///< share of disparities clearly below 0
  double brightness_ratio = 1.0;       ///< median, right to left, of the grey levels around them

  double obscured_left = 0.0;  ///< share of the image, see LensMeasurement
  double obscured_right = 0.0;

  bool identical = false;  ///< both images are the same, byte for byte, and not of one colour

  bool valid() const { return matches >= kFewestMatches; }
};

/// Matches points of two images that may be badly rectified, rotated or swapped: in all columns and
/// within a sixth of the height, in both directions. Vertical disparities of correct pairs change
/// smoothly over the image; other pairs are outliers. Takes about as long as a frame of the
/// odometry. What is masked (see StereoImages) is left out. \param left,right CV_8UC1 of any size;
/// anything else gives no matches. \param left_mask,right_mask of the same sizes, or empty.
PairMeasurement measurePair(const cv::Mat& left, const cv::Mat& right,
                            const cv::Mat& left_mask = {}, const cv::Mat& right_mask = {});

}  // namespace point_line_odometry
