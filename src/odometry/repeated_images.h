#pragma once

#include <cstdint>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <tuple>

#include "motion/frame_intervals.h"
#include "odometry/pose_integrator.h"
#include "point_line_odometry/motion_prior.h"
#include "point_line_odometry/types.h"

namespace point_line_odometry {

/// Recognises pairs that have an image of the previous frame again, byte for byte, as from a driver
/// that hangs or hands out a buffer twice: they show no motion, or a wrong one. The noise of a
/// camera that is stationary changes most pixels from frame to frame, up and down alike; once it
/// has been seen, each repetition is the driver's. Until then one of a camera without noise, as a
/// simulated one, or behind a video codec, is possible, and both images may be those of a
/// stationary camera.
class RepeatedImages {
 public:
  /// False before the first frame. \param images as they are processed. \param intervals of the
  /// frames before. \param velocity the last estimate, current or not, of any frame; nothing if
  /// unknown. \param prior of the motion since the previous frame; null: none.
  bool areIn(const StereoImages& images, const FrameIntervals& intervals,
             const std::optional<CameraVelocity>& velocity, const MotionPrior* prior) const;

  /// Learns whether the camera has noise. \param curr measured, after the previous frame.
  /// \param stationary whether the camera is.
  void learn(const StereoImages& curr, bool stationary);

  /// The previous frame from now on. Its pixels must not change.
  void remember(const StereoImages& images) {
    left_ = images.left;
    right_ = images.right;
    stamp_ns_ = images.stamp_ns;
  }

  bool cameraHasNoise() const;

  /// All members, for StereoOdometry::saveState().
  auto state() {
    auto& [left, right, stamp_ns, noisy_frames, believed] = *this;
    return std::tie(left, right, stamp_ns, noisy_frames, believed);
  }

 private:
  cv::Mat left_;  // of the previous frame
  cv::Mat right_;
  std::int64_t stamp_ns_ = 0;
  int noisy_frames_ = 0;   // in a row, while stationary; repeated ones between them do not count
  bool believed_ = false;  // the previous frame repeated the one before, and was measured
};

}  // namespace point_line_odometry
