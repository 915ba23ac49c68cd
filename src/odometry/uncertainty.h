#pragma once

#include <Eigen/Geometry>

#include "geometry/se3.h"
#include "point_line_odometry/motion_prior.h"
#include "point_line_odometry/types.h"

namespace point_line_odometry {

/// Motion over dt at a constant velocity (linear [m/s], angular [rad/s], in the camera's axes).
Eigen::Isometry3d motionAtVelocity(const Vector6d& velocity, double dt_s);

/// The constant velocity in the camera's axes that gives the motion T_prev_curr in dt.
Vector6d velocityOfMotion(const Eigen::Isometry3d& T_prev_curr, double dt_s);

/// Covariance of a motion over dt that is predicted from a velocity last estimated `unmeasured_s`
/// ago; without a usable velocity (`speed_known` false) it must allow for standing still as well as
/// for going on.
Matrix6d predictionCovariance(const Vector6d& velocity, bool speed_known, double dt_s,
                              double unmeasured_s);

/// Covariance of the motion between the ends of two motions from the same camera, T_begin_last and
/// another, along and about the axes of the camera at the end of the first. \param last, curr of
/// both, independent of each other, along and about the axes of the camera that they are from.
Matrix6d covarianceBetween(const Eigen::Isometry3d& T_begin_last, const Matrix6d& last,
                           const Matrix6d& curr);

/// A motion that is expected before images are compared.
struct PredictedMotion {
  Eigen::Isometry3d T_prev_curr = Eigen::Isometry3d::Identity();
  Matrix6d covariance = Matrix6d::Zero();  ///< along and about the axes of the previous camera
};

/// The motion over dt at a constant velocity, fused with a prior by their covariances: axes that
/// the prior does not know follow the velocity in the camera's own axes, so that a camera that is
/// known to turn goes on along its curve.
/// \param covariance of the motion without the prior. \param prior null: none.
PredictedMotion predictedMotion(const Vector6d& velocity, const Matrix6d& covariance, double dt_s,
                                const MotionPrior* prior);

}  // namespace point_line_odometry
