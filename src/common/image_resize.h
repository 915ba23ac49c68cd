#pragma once

#include <opencv2/core.hpp>

namespace point_line_odometry {

/// The image in another size: means of areas where it is smaller, else bicubic interpolation.
cv::Mat resized(const cv::Mat& image, const cv::Size& size);

/// The mask of such an image: a pixel that takes something from an ignored one (0) is ignored, the
/// others are 255. Empty without a mask.
cv::Mat resizedMask(const cv::Mat& mask, const cv::Size& size);

}  // namespace point_line_odometry
