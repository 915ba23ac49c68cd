#pragma once

#include <Eigen/Geometry>

#include "motion/correspondence.h"
#include "motion/motion_estimator.h"
#include "point_line_odometry/parameters.h"

namespace point_line_odometry {

/// A motion predicted from an estimated velocity.
struct ConstantVelocityMotion {
  Eigen::Isometry3d T_curr_prev = Eigen::Isometry3d::Identity();
  Matrix6d covariance = Matrix6d::Zero();  ///< by that of the velocity, as MotionEstimate's
  double dt_s = 0.0;
};

/// Whether a motion that was estimated differs from the predicted one by no more than a camera's
/// acceleration and the noise of both explain.
bool isPlausible(const MotionEstimate& motion, const ConstantVelocityMotion& predicted);

/// As estimateMotion(), but robust to independently moving objects that fill most of the view. If
/// the motion of the majority of matches is not plausible, the motion is estimated from the matches
/// near the prediction, and returned if it is plausible.
MotionEstimate estimateCameraMotion(const Correspondences& correspondences,
                                    const StereoCamera& camera,
                                    const ConstantVelocityMotion& predicted,
                                    const MotionParameters& parameters,
                                    ThreadPool* threads = nullptr);

}  // namespace point_line_odometry
