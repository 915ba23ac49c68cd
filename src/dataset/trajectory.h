#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <iosfwd>
#include <string>
#include <vector>

#include "common/input_error.h"

namespace point_line_odometry {

/// Pose of a camera (or body) in a fixed frame at a time.
struct StampedPose {
  std::int64_t stamp_ns = 0;
  Eigen::Isometry3d T_world_camera = Eigen::Isometry3d::Identity();
};

/// Rows of "stamp tx ty tz qx qy qz qw" [s, m], qw >= 0, nine decimals of the stamp, the same bytes
/// for the same poses.
void writeTum(std::ostream& out, const std::vector<StampedPose>& trajectory);

/// Poses of a file in the layout of writeTum(); blank lines and comments (#) are skipped.
/// Throws InputError if it is missing or empty, or names the row that is not 8 numbers with a unit
/// quaternion and a later stamp than the row before.
std::vector<StampedPose> readTum(const std::string& file);

/// Rows of the 12 numbers of the 3 x 4 matrix, row-major [m].
void writeKitti(std::ostream& out, const std::vector<StampedPose>& trajectory);

}  // namespace point_line_odometry
