#pragma once

#include <map>
#include <string>

#include "point_line_odometry/motion_prior.h"

namespace point_line_odometry {

/// Motion priors by the stamp at which they end.
using PriorsByStamp = std::map<std::int64_t, MotionPrior>;

/// Reads a file with a motion of the left camera (as the trajectory: of the raw one for raw images)
/// in each row: "from_s to_s tx ty tz qx qy qz qw stx sty stz srx sry srz", its pose at the second
/// stamp in that at the first [m], and standard deviations along and about the axes of the first
/// [m, rad]; 0: the axis is unknown. Throws InputError for anything else.
PriorsByStamp readPriors(const std::string& file);

}  // namespace point_line_odometry
