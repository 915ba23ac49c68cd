#include "odometry/compute_governor.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

#include "common/statistics.h"

namespace point_line_odometry {
namespace {

constexpr double kLargestCut = 0.5;    // one decision takes at most this share away
constexpr double kSmallestCut = 0.05;  // and at least this one
constexpr double kAim = 0.9;           // share of the target that a cut aims at
constexpr double kRise = 1.1;
// Below this share of the target there is room for one rise: 0.8 * 1.1 is still below kAim.
constexpr double kRoomBelow = 0.8;

}  // namespace

ComputeGovernor::ComputeGovernor(double target_ms) : target_ms_(target_ms) {
  if (!std::isfinite(target_ms) || target_ms < 0.0) {
    throw std::invalid_argument("target_frame_time_ms is " + std::to_string(target_ms) +
                                ", but must be 0 or more");
  }
}

double ComputeGovernor::addFrame(double frame_ms) {
  if (target_ms_ == 0.0 || !std::isfinite(frame_ms) || frame_ms < 0.0) return budget_;
  times_ms_.push_back(frame_ms);
  if (times_ms_.size() < kFramesPerDecision) return budget_;
  const double median_ms = median(times_ms_);
  times_ms_.clear();
  if (median_ms > target_ms_) {
    const double wanted = kAim * target_ms_ / median_ms;
    budget_ =
        std::max(kMinBudget, budget_ * std::clamp(wanted, 1.0 - kLargestCut, 1.0 - kSmallestCut));
  } else if (median_ms < kRoomBelow * target_ms_) {
    budget_ = std::min(1.0, budget_ * kRise);
  }
  return budget_;
}

Parameters withFeatureBudget(Parameters parameters, double share) {
  for (int* count : {&parameters.points.max_per_cell, &parameters.lines.max_count})
    *count = std::max(1, static_cast<int>(std::lround(share * *count)));
  return parameters;
}

}  // namespace point_line_odometry
