#pragma once

#include <vector>

#include "checks/sequence_check.h"
#include "ros/doctor_report.h"

namespace point_line_odometry {

/// The lines on what consecutive pairs tell: whether both cameras take their images at the same
/// time and all of their rows, and whether a projector lights the scene.
std::vector<DoctorLine> checkSequence(const SequenceMeasurement& sequence);

}  // namespace point_line_odometry
