#pragma once

#include <opencv2/core.hpp>

namespace point_line_odometry {

/// The shares (0 ... 1) of the images of a pair that one lens shows with less than a third of the
/// contrast of the other one: where it is covered, dirty or out of focus.
struct LensMeasurement {
  double left_share = 0.0;
  double right_share = 0.0;
};

/// Compares the contrast of fine structure around a pixel with the least one around all pixels of
/// the other image that may show the same, of disparities up to a fifth of the width. Rows need not
/// be rectified exactly. \param left,right CV_8UC1 of one size. \param left_mask,right_mask of this
/// size, or empty: what is masked is left out.
LensMeasurement measureLenses(const cv::Mat& left, const cv::Mat& right, const cv::Mat& left_mask,
                              const cv::Mat& right_mask);

}  // namespace point_line_odometry
