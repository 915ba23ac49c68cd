#include "odometry/frame_clock.h"

#include <algorithm>

#include "point_line_odometry/types.h"

namespace point_line_odometry {
namespace {

// Cameras that drop frames have intervals of one, two, three periods: half of their mean is hardly
// more than one.
constexpr double kLeastShare = 0.5;

constexpr int kAveraged = 5;  // intervals

// A gap is no interval of the camera: after the first intervals, no more than so many times their
// mean counts.
constexpr int kFirst = 3;
constexpr double kMostTimesMean = 3.0;

}  // namespace

std::int64_t FrameClock::timeOf(std::int64_t stamp_ns) const {
  if (!stamp_ns_) return stamp_ns;
  const auto least_ns = static_cast<std::int64_t>(1e9 * kLeastShare * mean_interval_s_);
  return std::max(stamp_ns, time_ns_ + least_ns);
}

double FrameClock::secondsTo(std::int64_t stamp_ns) const {
  return stamp_ns_ ? toSeconds(timeOf(stamp_ns) - time_ns_) : 0.0;
}

void FrameClock::add(std::int64_t stamp_ns) {
  time_ns_ = timeOf(stamp_ns);
  if (stamp_ns_) {
    double interval_s = toSeconds(stamp_ns - *stamp_ns_);
    if (num_intervals_ >= kFirst)
      interval_s = std::min(interval_s, kMostTimesMean * mean_interval_s_);
    num_intervals_ = std::min(num_intervals_ + 1, kAveraged);
    mean_interval_s_ += (interval_s - mean_interval_s_) / num_intervals_;
  }
  stamp_ns_ = stamp_ns;
}

}  // namespace point_line_odometry
