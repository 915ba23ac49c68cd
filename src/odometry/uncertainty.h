#pragma once

#include <Eigen/Geometry>

#include "point_line_odometry/types.h"

namespace point_line_odometry {

/// Covariance of T_odom_curr = T_odom_prev * T_prev_curr, from that of the pose (along and about
/// the axes of odom) and that of the motion (along and about the axes of prev), to first order.
Matrix6d composeCovariance(const Eigen::Isometry3d& T_odom_prev, const Matrix6d& pose_covariance,
                           const Eigen::Isometry3d& T_prev_curr, const Matrix6d& motion_covariance);

/// Translation and rotation from a to b, along and about the axes of odom [m, rad].
Vector6d poseDifference(const Eigen::Isometry3d& T_odom_a, const Eigen::Isometry3d& T_odom_b);

/// Motion over dt at a constant velocity (linear [m/s], angular [rad/s], in the camera's axes).
Eigen::Isometry3d motionAtVelocity(const Vector6d& velocity, double dt_s);

/// The constant velocity in the camera's axes that leads over T_prev_curr in dt.
Vector6d velocityOfMotion(const Eigen::Isometry3d& T_prev_curr, double dt_s);

/// Covariance of a motion over dt that is predicted from a velocity last measured `unmeasured_s`
/// ago; without a usable velocity
/// (`speed_known` false) it must allow for standing still as well as for going on.
Matrix6d predictionCovariance(const Vector6d& velocity, bool speed_known, double dt_s,
                              double unmeasured_s);

}  // namespace point_line_odometry
