#pragma once

#include <vector>

#include "ros/doctor_facts.h"
#include "ros/doctor_report.h"

namespace point_line_odometry {

/// The lines on images, calibration and the measurements of an image pair.
std::vector<DoctorLine> checkCamera(const DoctorFacts& facts);

}  // namespace point_line_odometry
