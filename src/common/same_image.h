#pragma once

#include <opencv2/core.hpp>

namespace point_line_odometry {

/// Whether two images are of the same size and the same, byte for byte. \param a, b CV_8UC1.
bool haveSameBytes(const cv::Mat& a, const cv::Mat& b);

/// The same, and not of one colour, as those of a covered lens. \param a, b CV_8UC1.
bool isSameImage(const cv::Mat& a, const cv::Mat& b);

}  // namespace point_line_odometry
