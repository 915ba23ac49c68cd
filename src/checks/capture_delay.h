#pragma once

#include <optional>
#include <vector>

#include "checks/followed_frame.h"

namespace point_line_odometry {

/// By how much later the right images are taken than the left ones.
struct CaptureDelay {
  double seconds = 0.0;
  double variance = 0.0;  ///< [s^2]
};

/// Measures the delay s of the right images. Nothing if no motion shows it.
///
/// A point that moves with the velocity (vx, vy) in the image is shifted there by s (vx, vy). Its
/// vertical disparity is s vy, beside what a wrong calibration does, which is smooth over the image
/// and the disparity d; and its disparity changes by -s times the change of vx, beside what the
/// camera's motion does, in first order a combination of 1, d^2, d x and d y. The velocities are
/// those of a smooth field that is fitted to all points. Errors are taken as alike in one frame,
/// and in one part of the image over all frames.
///
/// \param frames in their order.
std::optional<CaptureDelay> measureDelay(const std::vector<const FollowedFrame*>& frames);

}  // namespace point_line_odometry
