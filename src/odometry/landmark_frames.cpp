#include "odometry/landmark_frames.h"

#include <algorithm>

namespace point_line_odometry {
namespace {

constexpr int kSettledFrames = 5;  // with a motion, in a row

// Largest share of new ones that is expected among the landmarks which the next frame with features
// will observe, for one without before it: where the view changes faster, as at every 2nd frame of
// a car, landmarks are seen too seldom as it is.
constexpr double kMostNew = 0.6;

}  // namespace

void LandmarkFrames::add(const TrackingResult& tracked, bool measured) {
  motion_.reset();
  if (tracked.by_landmarks) {
    motion_ = tracked.image_motion;
    ++in_a_row_;
    return;
  }
  in_a_row_ = 0;
  if (tracked.reason == TrackingReason::kRepeatedImages) return;  // no doubt
  const bool settled = measured && !tracked.relocalized;
  settled_ = settled ? std::min(settled_ + 1, kSettledFrames) : 0;
}

bool LandmarkFrames::isSettled() const { return settled_ == kSettledFrames; }

bool LandmarkFrames::mayFollow(const LocalMap& map, double next_s,
                               const TrackingParameters& parameters) const {
  return in_a_row_ < parameters.landmark_frames && isSettled() &&
         next_s <= std::min(parameters.max_frame_gap_s, parameters.max_prediction_s) &&
         map.shareOfNew() * next_s <= kMostNew * previous_span_s_;
}

}  // namespace point_line_odometry
