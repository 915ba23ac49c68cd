#pragma once

#include <opencv2/core.hpp>

#include "point_line_odometry/frame_result.h"

namespace point_line_odometry {

/// BGR image of a frame: the left image with points yellow and segments red (as in the paper's
/// figures), matched ones bright, outliers marked with a cross or thin blue, and the state, counts
/// and time in text. \param left rectified left image, CV_8UC1; it is not changed. \param mask of
/// the image, which is dimmed where the mask is 0; empty: nowhere.
cv::Mat drawFeatures(const cv::Mat& left, const FrameResult& result, const cv::Mat& mask = {});

}  // namespace point_line_odometry
