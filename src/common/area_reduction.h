#pragma once

#include <opencv2/core/mat.hpp>

namespace point_line_odometry {

/// The image in a smaller size, each pixel the mean of the area that it covers, as of cv::resize()
/// with INTER_AREA. That takes three times as long for factors that are no whole numbers, and waits
/// for OpenCV's threads.
/// \param image CV_8UC1. \param size at most the image's, in both directions.
cv::Mat areaReduced(const cv::Mat& image, const cv::Size& size);

/// The image at half its size, each pixel the mean of four; the last row or column of an odd number
/// is left out. Pixel (u, v) is at (2 u + 0.5, 2 v + 0.5) in the image. The same as areaReduced()
/// of an even number of rows and columns, in a seventh of the time. \param image CV_8UC1. \param
/// half its memory is reused if it has the size.
void halve(const cv::Mat& image, cv::Mat* half);

}  // namespace point_line_odometry
