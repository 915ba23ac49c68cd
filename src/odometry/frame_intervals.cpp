#include "odometry/frame_intervals.h"

#include <algorithm>
#include <cstddef>
#include <numeric>

namespace point_line_odometry {
namespace {

constexpr std::size_t kMost = 8;
constexpr double kGap_s = 1.0;  // what is longer is no interval of a camera

}  // namespace

void FrameIntervals::add(double interval_s) {
  if (!(interval_s > 0.0 && interval_s <= kGap_s)) return;
  if (latest_s_.size() == kMost) latest_s_.erase(latest_s_.begin());
  latest_s_.push_back(interval_s);
}

double FrameIntervals::usual() const {
  if (latest_s_.size() < 2) return 0.0;
  const double longest_s = *std::max_element(latest_s_.begin(), latest_s_.end());
  const double sum_s = std::accumulate(latest_s_.begin(), latest_s_.end(), -longest_s);
  return std::max(sum_s, 0.0) / static_cast<double>(latest_s_.size() - 1);
}

}  // namespace point_line_odometry
