#pragma once

#include <opencv2/core.hpp>

#include "point_line_odometry/stereo_odometry.h"

namespace point_line_odometry {

/// BGR picture of a frame: the left image with points yellow and segments red (as in the paper's
/// figures), matched ones bright, outliers marked with a cross or thin blue, and the state, counts
/// and time in text. \param left rectified left image, CV_8UC1; it is not changed.
cv::Mat drawFeatures(const cv::Mat& left, const FrameResult& result);

}  // namespace point_line_odometry
