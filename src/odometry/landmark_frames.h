#pragma once

#include <optional>
#include <tuple>

#include "map/local_map.h"
#include "odometry/tracking_result.h"
#include "point_line_odometry/frame_result.h"
#include "point_line_odometry/parameters.h"

namespace point_line_odometry {

/// Decides which frames are tracked by landmarks alone (tracking/landmark_frames), and keeps the
/// motion to the last of them. The previous frame is the last one with features.
class LandmarkFrames {
 public:
  /// Adds the tracking result of a frame. \param measured whether its motion is known.
  void add(const TrackingResult& tracked, bool measured);

  /// A frame becomes the previous one, so much later than the one before it [s].
  void setPreviousSpan(double span_s) { previous_span_s_ = span_s; }

  /// A new map begins, which has few landmarks at first, or a frame could not be processed.
  void unsettle() { settled_ = 0; }

  /// The motion of the last frame is predicted, or the previous frame is another one.
  void forgetMotion() { motion_.reset(); }

  /// Whether motions of enough frames with features are known in a row. At the beginning of a map
  /// and after any doubt it has few landmarks, and the next frame needs all features there are.
  bool isSettled() const;

  /// Whether the next frame may be one: settled, not too many in a row, and a view that changes
  /// slowly enough for the one with features after it.
  /// \param next_s time from the previous frame to that [s].
  bool mayFollow(const LocalMap& map, double next_s, const TrackingParameters& parameters) const;

  /// Motion by the images from the previous frame to the last one; nothing if that is the previous
  /// frame, or had none.
  const std::optional<ImageMotion>& motion() const { return motion_; }

  auto state() {
    auto& [settled, span_s, in_a_row, motion] = *this;
    return std::tie(settled, span_s, in_a_row, motion);
  }

 private:
  int settled_ = 0;  // frames with features and a motion, since the last one without; up to a few
  double previous_span_s_ = 0.0;  // time between the previous frame and the one before it
  int in_a_row_ = 0;              // since the previous frame
  std::optional<ImageMotion> motion_;
};

}  // namespace point_line_odometry
