#pragma once

#include <Eigen/Geometry>

#include "point_line_odometry/motion.h"

namespace point_line_odometry {

/// As estimateMotion(), but stands things that fill most of the view and move by themselves. Where
/// the motion that most matches agree on is further from the predicted one than a camera can have
/// changed it within `dt_s`, the matches that lie where the prediction puts them are asked: theirs
/// is the camera's if it is plausible. \param T_curr_prev_predicted from a velocity that was
/// measured.
MotionEstimate estimateCameraMotion(const Correspondences& correspondences,
                                    const StereoCamera& camera,
                                    const Eigen::Isometry3d& T_curr_prev_predicted, double dt_s,
                                    const MotionParameters& parameters);

}  // namespace point_line_odometry
