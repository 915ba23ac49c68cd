#pragma once

#include <opencv2/core.hpp>
#include <optional>

namespace point_line_odometry {

/// The column at which a seam begins that runs through both images from top to bottom: they were
/// cut from one that shows both cameras side by side, but not at the border of the two, so that a
/// strip of each is from the other one. Nothing if there is none: an edge of the scene that fills
/// the height is as near as that, and so in other columns of the other image. \param left,right
/// CV_8UC1 as the cameras took them, not rectified; of different sizes they have none.
std::optional<int> commonSeam(const cv::Mat& left, const cv::Mat& right);

}  // namespace point_line_odometry
