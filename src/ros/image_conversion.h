#pragma once

#include <sensor_msgs/Image.h>

#include <opencv2/core/mat.hpp>

#include "point_line_odometry/rectification.h"
#include "point_line_odometry/types.h"
#include "ros/conversions.h"

namespace point_line_odometry {

/// Converts an image message to grey, CV_8UC1. Accepts mono8, 8UC1, mono16, 16UC1 (v / 256, rounded
/// down), bgr8, rgb8, bgra8 and rgba8. Throws MessageError for other encodings and for sizes that
/// contradict each other, before a pixel is read. For mono8 and 8UC1 the result shares the memory
/// of the message: keep the message as long as the result, and never write to it.
cv::Mat toGray(const sensor_msgs::Image& image);

/// A copy of a mask, CV_8UC1. Throws MessageError if it is not mono8 (or 8UC1) or not of the
/// camera's size.
cv::Mat toMask(const sensor_msgs::Image& mask, const CameraCalibration& camera);

/// Both images of a pair, as toGray(), with the stamp of the left one. Throws MessageError also if
/// the size of an image is not that of its calibration. Messages must outlive the result.
StereoImages toStereoImages(const sensor_msgs::Image& left, const sensor_msgs::Image& right,
                            const StereoCalibration& calibration);

}  // namespace point_line_odometry
