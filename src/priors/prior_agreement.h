#pragma once

#include "point_line_odometry/frame_result.h"
#include "point_line_odometry/motion_prior.h"

namespace point_line_odometry {

/// Whether a prior agrees with the motion that the images of a frame gave (PriorFactor::agrees()).
bool agrees(const MotionPrior& prior, const ImageMotion& images);

}  // namespace point_line_odometry
