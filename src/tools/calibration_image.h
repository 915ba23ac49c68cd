#pragma once

#include <opencv2/core/mat.hpp>

#include "tools/calibration_check.h"

namespace point_line_odometry {

/// BGR image of the residual field: the last left image above the right one, dimmed, with an
/// arrow in each part of them. Green: what is measured against the calibration; orange, in the
/// right image: the displacement that the online stereo calibration has estimated. A legend has the
/// length of an arrow.
cv::Mat drawCalibration(const CalibrationReport& report);

}  // namespace point_line_odometry
