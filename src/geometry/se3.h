#pragma once

/// \file
/// Rotations and rigid motions. A rotation vector is the axis times the angle [rad]. Vectors and
/// matrices of six are in ROS' order, translation [m] before rotation [rad].

#include <Eigen/Geometry>

#include "point_line_odometry/types.h"

namespace point_line_odometry {

/// The matrix of a cross product: skew(a) * b = a x b.
inline Eigen::Matrix3d skew(const Eigen::Vector3d& a) {
  Eigen::Matrix3d m;
  m << 0.0, -a.z(), a.y(),  //
      a.z(), 0.0, -a.x(),   //
      -a.y(), a.x(), 0.0;
  return m;
}

/// The rotation of a rotation vector (exponential map of SO(3)).
Eigen::Matrix3d expSO3(const Eigen::Vector3d& rotation);

/// The rotation vector of a rotation, its angle in [0, pi] (logarithm of SO(3)).
Eigen::Vector3d logSO3(const Eigen::Matrix3d& R);

/// The angle of a rotation, in [0, pi].
double rotationAngle(const Eigen::Matrix3d& R);

/// Left Jacobian of SO(3): exp(w + dw) = exp(J dw) exp(w) to first order.
Eigen::Matrix3d leftJacobian(const Eigen::Vector3d& w);

/// Translation and rotation from a to b, along and about the axes of odom.
Vector6d poseDifference(const Eigen::Isometry3d& T_odom_a, const Eigen::Isometry3d& T_odom_b);

/// The pose b at such a difference from a.
Eigen::Isometry3d addPoseDifference(const Eigen::Isometry3d& T_odom_a, const Vector6d& difference);

/// diag(R_a_b, R_a_b): rotates a vector of six from the axes of b to those of a.
Matrix6d blockRotation(const Eigen::Matrix3d& R_a_b);

/// Adjoint of SE(3): twist_a = A * twist_b for frames a and b fixed to one rigid body; twists are
/// linear, then angular velocity of the frame's origin in the frame's own axes.
Matrix6d adjoint(const Eigen::Isometry3d& T_a_b);

/// Covariance of T_odom_curr = T_odom_prev * T_prev_curr, from that of the pose (along and about
/// the axes of odom) and that of the motion (along and about the axes of prev), to first order.
Matrix6d composeCovariance(const Eigen::Isometry3d& T_odom_prev, const Matrix6d& pose_covariance,
                           const Eigen::Isometry3d& T_prev_curr, const Matrix6d& motion_covariance);

}  // namespace point_line_odometry
