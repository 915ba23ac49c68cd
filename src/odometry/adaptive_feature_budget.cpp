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
// With a smaller share of features every second frame may be tracked by landmarks.
constexpr double kFeaturesAlone = 0.7;
// What that gains at most: every second frame takes a fraction of the time.
constexpr double kByLandmarks = 2.0;
constexpr std::size_t kFramesOfAKind = 3;  // of which a median is not changed by one
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

FeatureBudget AdaptiveFeatureBudget::addFrame(double frame_ms, bool by_landmarks) {
  if (target_ms_ == 0.0 || !std::isfinite(frame_ms) || frame_ms < 0.0) return budget_;
  const bool is_first = with_features_ms_.empty() && by_landmarks_ms_.empty();
  if (is_first) begins_by_landmarks_ = by_landmarks;
  (by_landmarks ? by_landmarks_ms_ : with_features_ms_).push_back(frame_ms);
  if (!knowsEnough(by_landmarks)) return budget_;
  const auto sum_of_medians = [](const std::vector<double>& times_ms) {
    return static_cast<double>(times_ms.size()) * median(times_ms);
  };
  const std::size_t num_frames = with_features_ms_.size() + by_landmarks_ms_.size();
  decide((sum_of_medians(with_features_ms_) + sum_of_medians(by_landmarks_ms_)) /
         static_cast<double>(num_frames));
  with_features_ms_.clear();
  by_landmarks_ms_.clear();
  return budget_;
}

/// Of both kinds in turns as many of each, and of each that occurs enough for a median that a
/// single one does not change. \param by_landmarks the last frame.
bool AdaptiveFeatureBudget::knowsEnough(bool by_landmarks) const {
  const std::size_t num_frames = with_features_ms_.size() + by_landmarks_ms_.size();
  if (num_frames < kFramesPerDecision) return false;
  if (num_frames >= 2 * kFramesPerDecision) return true;
  const auto few = [](const std::vector<double>& times_ms) {
    return !times_ms.empty() && times_ms.size() < kFramesOfAKind;
  };
  const bool ends_amid_turn = !by_landmarks_ms_.empty() && by_landmarks == begins_by_landmarks_;
  return !ends_amid_turn && !few(with_features_ms_) && !few(by_landmarks_ms_);
}

/// By the mean time of frames of any kind.
void AdaptiveFeatureBudget::decide(double mean_ms) {
  const double room_below_ms = kRoomBelow * target_ms_;
  if (mean_ms <= target_ms_ && mean_ms >= room_below_ms) return;
  // A part of the time does not depend on the budget, so that this changes it by less than wanted
  // and never beyond the aim.
  double wanted = kAim * target_ms_ / std::max(mean_ms, kShortest_ms);
  if (mean_ms < room_below_ms) {
    const bool all_fit = budget_.share == 1.0 && !with_features_ms_.empty() &&
                         median(with_features_ms_) < room_below_ms;
    if (all_fit) budget_.landmark_frames = false;
  } else if (!budget_.landmark_frames && budget_.share * wanted < kFeaturesAlone) {
    budget_.landmark_frames = true;
    if (by_landmarks_ms_.empty()) wanted = std::min(kByLandmarks * wanted, 1.0);
  }
  budget_.share =
      std::clamp(budget_.share * std::clamp(wanted, kLargestCut, kLargestRise), kMinShare, 1.0);
}

Parameters withFeatureBudget(Parameters parameters, const FeatureBudget& budget) {
  const double share = budget.share;
  if (budget.landmark_frames)
    parameters.tracking.landmark_frames = std::max(parameters.tracking.landmark_frames, 1);
  // The last one, as lines would take longer where there are fewer points. Its 0 has a meaning.
  for (int* count : {&parameters.points.max_per_cell, &parameters.lines.max_count,
                     &parameters.lines.coarse_to_fine_points})
    *count = std::max(std::min(*count, 1), static_cast<int>(std::lround(share * *count)));
  if (share < 1.0) {
    double& gradient = parameters.lines.min_gradient;
    gradient = std::max(gradient, std::min(gradient / share, kLargestGradient));
  }
  return parameters;
}

}  // namespace point_line_odometry
