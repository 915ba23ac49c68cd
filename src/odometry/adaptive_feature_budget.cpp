#include "odometry/adaptive_feature_budget.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

#include "common/statistics.h"

namespace point_line_odometry {
namespace {

constexpr double kAim = 0.95;        // of the target time
constexpr double kRoomBelow = 0.9;   // share of the target below which there is room for more
constexpr double kLargestCut = 0.5;  // factor of one decision
constexpr double kLargestRise = 1.25;
// Of one decision in favour of landmark frames: every second frame takes hardly any time.
constexpr double kByLandmarks = 2.0;
constexpr double kShortest_ms = 1e-3;
constexpr double kLargestGradient = 255.0;  // of lines/min_gradient [grey levels / px]

}  // namespace

bool operator==(const FeatureBudget& a, const FeatureBudget& b) {
  return a.share == b.share && a.landmark_frames == b.landmark_frames;
}

bool operator!=(const FeatureBudget& a, const FeatureBudget& b) { return !(a == b); }

AdaptiveFeatureBudget::AdaptiveFeatureBudget(double target_ms) : target_ms_(target_ms) {
  if (!std::isfinite(target_ms) || target_ms < 0.0) {
    throw std::invalid_argument("target_frame_time_ms is " + std::to_string(target_ms) +
                                ", but must be 0 or more");
  }
}

const FeatureBudget& AdaptiveFeatureBudget::addFrame(double frame_ms, bool by_landmarks) {
  if (target_ms_ == 0.0 || !std::isfinite(frame_ms) || frame_ms < 0.0) return budget_;
  const bool is_first = with_features_ms_.empty() && by_landmarks_ms_.empty();
  if (is_first) begins_by_landmarks_ = by_landmarks;
  (by_landmarks ? by_landmarks_ms_ : with_features_ms_).push_back(frame_ms);
  const std::size_t num_frames = with_features_ms_.size() + by_landmarks_ms_.size();
  // Of both kinds in turns as many of each.
  const bool ends_amid_turn = !by_landmarks_ms_.empty() && by_landmarks == begins_by_landmarks_;
  if (num_frames < kFramesPerDecision || (ends_amid_turn && num_frames < 2 * kFramesPerDecision))
    return budget_;
  const auto sum_of_medians = [](const std::vector<double>& times_ms) {
    return static_cast<double>(times_ms.size()) * median(times_ms);
  };
  const double mean_ms = (sum_of_medians(with_features_ms_) + sum_of_medians(by_landmarks_ms_)) /
                         static_cast<double>(num_frames);
  decide(mean_ms, with_features_ms_.empty() ? mean_ms : median(with_features_ms_));
  with_features_ms_.clear();
  by_landmarks_ms_.clear();
  return budget_;
}

/// By the times that a frame of any kind, and one with features, has taken.
void AdaptiveFeatureBudget::decide(double mean_ms, double with_features_ms) {
  const double room_below_ms = kRoomBelow * target_ms_;
  if (mean_ms <= target_ms_ && mean_ms >= room_below_ms) return;
  // A part of the time does not depend on the budget, so that this changes it by less than wanted
  // and never beyond the aim.
  double wanted = kAim * target_ms_ / std::max(mean_ms, kShortest_ms);
  if (mean_ms > target_ms_ && !budget_.landmark_frames) {
    budget_.landmark_frames = true;
    wanted = std::min(kByLandmarks * wanted, 1.0);
  } else if (budget_.share == 1.0 && with_features_ms < room_below_ms) {
    budget_.landmark_frames = false;
  }
  budget_.share =
      std::clamp(budget_.share * std::clamp(wanted, kLargestCut, kLargestRise), kMinShare, 1.0);
}

Parameters withFeatureBudget(Parameters parameters, const FeatureBudget& budget) {
  const double share = budget.share;
  if (budget.landmark_frames)
    parameters.tracking.landmark_frames = std::max(parameters.tracking.landmark_frames, 1);
  for (int* count : {&parameters.points.max_per_cell, &parameters.lines.max_count})
    *count = std::max(1, static_cast<int>(std::lround(share * *count)));
  if (share < 1.0) {
    double& gradient = parameters.lines.min_gradient;
    gradient = std::max(gradient, std::min(gradient / share, kLargestGradient));
  }
  return parameters;
}

}  // namespace point_line_odometry
