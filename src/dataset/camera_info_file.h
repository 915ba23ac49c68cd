#pragma once

#include <string>

#include "point_line_odometry/rectification.h"

namespace point_line_odometry {

/// Reads a camera's calibration from a yaml file of camera_calibration, as camera_info_manager
/// loads it. Throws InputError that names the file and the field if it cannot be used.
CameraCalibration readCameraInfo(const std::string& file);

/// The text of such a file. \param name of the camera.
std::string formatCameraInfo(const CameraCalibration& camera, const std::string& name);

}  // namespace point_line_odometry
