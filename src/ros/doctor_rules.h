#pragma once

/// \file
/// The rules of the doctor: from facts on the input of the odometry to lines with faults and hints.
/// Free functions that need no node; shared by the nodelet and the tool `doctor`.

#include <vector>

#include "ros/doctor_facts.h"
#include "ros/doctor_report.h"

namespace point_line_odometry {

/// The lines of the report: topics, camera, mounting, speed and clock.
std::vector<DoctorLine> checkInput(const DoctorFacts& facts);

}  // namespace point_line_odometry
