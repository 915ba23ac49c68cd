#pragma once

#include <vector>

#include "ros/doctor_facts.h"
#include "ros/doctor_report.h"

namespace point_line_odometry {

/// The lines on topics and stamps, which do not depend on the content of messages.
std::vector<DoctorLine> checkTopics(const DoctorFacts& facts);

}  // namespace point_line_odometry
