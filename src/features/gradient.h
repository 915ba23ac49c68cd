#pragma once

#include <opencv2/core.hpp>

namespace point_line_odometry {

/// Gradient of a smoothed image by the 3 x 3 Sobel operator; 8 units are one grey level per pixel.
/// Lines are detected and described from it.
struct GradientImage {
  cv::Mat gx;         ///< CV_16SC1
  cv::Mat gy;         ///< CV_16SC1
  cv::Mat magnitude;  ///< CV_16UC1, |gx| + |gy|
  cv::Mat smooth;     ///< CV_8UC1, the image after a 5 x 5 Gaussian (sigma 1 px)
  cv::Mat coarse;     ///< CV_8SC2, (gx, gy) / 4, saturated: a quarter of the memory

  /// Pixels around `coarse` that may be read, too; they are 0.
  static constexpr int kCoarseMargin = 34;
};

/// Smooths a CV_8UC1 image and differentiates it. The memory of `gradient` is reused if it has the
/// image's size.
void computeGradient(const cv::Mat& image, GradientImage* gradient);

}  // namespace point_line_odometry
