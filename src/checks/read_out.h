#pragma once

#include <optional>
#include <vector>

#include "checks/followed_frame.h"
#include "point_line_odometry/rectification.h"

namespace point_line_odometry {

/// The time from the exposure of the first row to that of the last one; negative if the last one
/// comes first.
struct ReadOut {
  double seconds = 0.0;
  double sigma_s = 0.0;  ///< standard deviation
};

/// Measures the read-out time of a rolling shutter, which is the same in both cameras, from the
/// flow of points; that of a global shutter is 0. Nothing if too few points were followed through
/// too few frames.
///
/// A point is seen a share of the read-out after the middle row, by its row in the raw image, and
/// the camera has moved on by its velocity times that. A rigid motion of the camera explains the
/// flow from frame to frame, but for what the velocities at both of them, from the motions before
/// and after, add to each row: it grows with the row's distance from the middle and the change of
/// the velocity, and with the vertical flow times the velocity. A wrong calibration does similar
/// things, which are those of a smooth displacement of the image and of the disparity, the same in
/// all frames; these, and a motion of its own for each frame, are eliminated (Frisch and Waugh
/// 1933). Gauss-Newton; the motions are fitted anew with each read-out.
///
/// \param frames in their order, of rectified images of this left camera. Where K, D and R cannot
/// rectify, the raw images are taken to be the rectified ones.
std::optional<ReadOut> measureReadOut(const std::vector<const FollowedFrame*>& frames,
                                      const CameraCalibration& left);

}  // namespace point_line_odometry
