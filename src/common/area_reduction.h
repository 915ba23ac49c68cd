#pragma once

#include <opencv2/core/mat.hpp>

namespace point_line_odometry {

/// The image in a smaller size, each pixel the mean of the area that it covers, as of cv::resize()
/// with INTER_AREA. That takes three times as long for factors that are no whole numbers, and waits
/// for OpenCV's threads.
/// \param image CV_8UC1. \param size at most the image's, in both directions.
cv::Mat areaReduced(const cv::Mat& image, const cv::Size& size);

}  // namespace point_line_odometry
