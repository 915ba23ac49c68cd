#pragma once

#include <opencv2/core/mat.hpp>
#include <string>

namespace point_line_odometry {

/// The pixels of a PNG file; `flags` are those of cv::imread(). Empty if the file is missing, no
/// PNG, cut off or damaged, or names a size of more than 2^26 pixels. Other formats are left out
/// because OpenCV asks a dozen libraries about bytes that it does not know, some of which believe
/// any size that a header names, or print warnings.
cv::Mat readPng(const std::string& file, int flags);

}  // namespace point_line_odometry
