#pragma once

#include <optional>

#include "matching/stereo_frame.h"
#include "odometry/frame_clock.h"
#include "odometry/pose_integrator.h"
#include "point_line_odometry/motion_prior.h"
#include "point_line_odometry/types.h"

namespace point_line_odometry {

/// Whether a pair has an image of the previous frame again, byte for byte, as from a driver that
/// hands out a buffer twice. The pair then shows no motion, or a wrong one. Both images of a camera
/// without noise, a simulated one, do so where it is stationary: these are repeated only if the
/// prior says that it moves on, or, where that does not know the translation, the velocity: for a
/// few frames, as a simulated robot may stop without braking.
/// \param images as they are processed. \param clock before this frame. \param velocity the last
/// estimate, current or not, of any frame; nothing if unknown. \param prior of the motion since the
/// previous frame; null: none.
bool areRepeated(const StereoImages& images, const StereoFrame& previous, const FrameClock& clock,
                 const std::optional<CameraVelocity>& velocity, const MotionPrior* prior);

}  // namespace point_line_odometry
