#pragma once

#include <Eigen/Geometry>

#include "point_line_odometry/motion.h"

namespace point_line_odometry {

/// As estimateMotion(), but stands things that fill most of the view and move by themselves. Where
/// the motion that the matches agree on is further from the predicted one than a robot can have
/// changed it within `dt_s`, or few agree on it, those that lie nearest to the prediction are
/// asked; a motion near it that enough matches follow is that of the camera.
MotionEstimate estimateCameraMotion(const Correspondences& correspondences,
                                    const StereoCamera& camera,
                                    const Eigen::Isometry3d& T_curr_prev_predicted, double dt_s,
                                    const MotionParameters& parameters);

}  // namespace point_line_odometry
