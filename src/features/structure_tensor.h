#pragma once

#include <opencv2/core/mat.hpp>
#include <vector>

namespace point_line_odometry {

/// A pixel at which the smaller eigenvalue of the structure tensor has a local maximum.
struct EigenvalueMaximum {
  int x = 0;
  int y = 0;
  float value = 0.0F;  ///< the eigenvalue, in units of a Sobel filter's gradient (8 grey levels/px)
};

/// Side of the block over which the structure tensor sums gradients [px].
constexpr int kStructureTensorSide = 9;

/// Maxima of the smaller eigenvalue of the structure tensor (Shi and Tomasi 1994), the sum of the
/// gradients' products over a block of kStructureTensorSide pixels: those above zero that no one of
/// the eight neighbours exceeds, row by row. Works through the image in rows, with sums in whole
/// numbers, so that it allocates a few rows only, and is exact but for the last square root.
/// \param image CV_8UC1. \param border [px] that is left out on all sides, at least 6: what a pixel
/// and its neighbours sum.
std::vector<EigenvalueMaximum> minEigenvalueMaxima(const cv::Mat& image, int border);

}  // namespace point_line_odometry
