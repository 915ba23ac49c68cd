#pragma once

/// \file
/// Construction of the lines of the doctor's report.

#include <string>

#include "ros/doctor_report.h"

namespace point_line_odometry {

// Of a time that does not tick.
constexpr const char* kHintForClock =
    "play bags with 'rosbag play --clock'; for a live camera 'rosparam set /use_sim_time false', "
    "then start its driver and the odometry again";

/// A number with fixed decimals.
std::string number(double value, int decimals);

/// A time as "12.3 ms".
std::string milliseconds(double seconds);

DoctorLine okLine(DoctorSubject subject, const std::string& text);
DoctorLine unknownLine(DoctorSubject subject, const std::string& text);
DoctorLine failureLine(DoctorSubject subject, DoctorLevel level, const std::string& text,
                       const std::string& hint);

/// An error from a sentence "fault; hint" or "fault: hint", as a MessageError has.
DoctorLine failureLine(DoctorSubject subject, const std::string& sentence);

}  // namespace point_line_odometry
