#pragma once

#include <Eigen/Geometry>

#include "point_line_odometry/tilt_correction.h"
#include "point_line_odometry/types.h"

namespace point_line_odometry {

/// Whether the numbers of a correction can be used: finite, of a unit vector, a rotation of less
/// than 90 degrees, a covariance.
bool isUsable(const TiltCorrection& correction);

/// The correction as a motion in odom: about a point, which stays where it is.
Eigen::Isometry3d aboutPoint(const TiltCorrection& correction, const Eigen::Vector3d& p_odom);

/// Covariance of a pose (along and about the axes of odom) after a correction of its tilt, which is
/// never less certain by that. Variances of position and yaw remain: of what they have in common
/// with the tilt, the part that remains of the tilt's error remains.
Matrix6d correctedCovariance(const Matrix6d& covariance, const TiltCorrection& correction);

}  // namespace point_line_odometry
