#pragma once

#include <opencv2/core.hpp>

namespace point_line_odometry {

/// Whether two images are the same, byte for byte, and not of one colour, as those of a covered
/// lens. Two images that a camera takes never are: their noise differs. \param a, b CV_8UC1.
bool isSameImage(const cv::Mat& a, const cv::Mat& b);

}  // namespace point_line_odometry
