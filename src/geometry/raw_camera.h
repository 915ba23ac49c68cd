#pragma once

/// \file
/// One camera of the pair as its lens shows it: its calibration checked and in OpenCV's types.

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>
#include <sstream>
#include <stdexcept>

#include "point_line_odometry/rectification.h"

namespace point_line_odometry {

/// A camera's intrinsics in OpenCV's types.
struct OpenCvCamera {
  cv::Matx33d K;
  cv::Mat D;
  bool fisheye = false;
};

/// Throws a std::invalid_argument of these parts.
template <typename... Parts>
[[noreturn]] void refuseCalibration(const Parts&... parts) {
  std::ostringstream text;
  text.precision(10);
  (text << ... << parts);
  throw std::invalid_argument(text.str());
}

/// Throws std::invalid_argument, as all of this file, if K, D and the distortion model do not fit.
/// \param side the camera's name in the message.
OpenCvCamera toOpenCv(const CameraCalibration& camera, const char* side);

/// Throws unless R is a rotation.
void requireRotation(const CameraCalibration& camera, const char* side);

/// Throws unless P has focal lengths.
void requireProjection(const CameraCalibration& camera, const char* side);

/// Pixels of the raw image that a rectified one takes its pixels from. \param rectified one pixel
/// in each column. P must be valid.
Eigen::Matrix2Xd rawPixels(const CameraCalibration& camera, const Eigen::Matrix2Xd& rectified);

}  // namespace point_line_odometry
