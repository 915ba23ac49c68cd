#pragma once

#include <Eigen/Core>

#include "point_line_odometry/rectification.h"

namespace point_line_odometry {

/// Pixels of the raw image that a rectified one takes its pixels from. \param rectified one pixel
/// in each column. Throws std::invalid_argument as StereoRectifier; P must be valid. Defined beside
/// it.
Eigen::Matrix2Xd rawPixels(const CameraCalibration& camera, const Eigen::Matrix2Xd& rectified);

}  // namespace point_line_odometry
