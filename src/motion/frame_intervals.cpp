#include "motion/frame_intervals.h"

#include <algorithm>
#include <cstddef>

#include "point_line_odometry/types.h"

namespace point_line_odometry {
namespace {

constexpr std::size_t kMost = 8;
constexpr double kGap_s = 1.0;  // what is longer is no interval of a camera
constexpr double kMostTimesMedian = 2.0;

}  // namespace

void FrameIntervals::add(double interval_s) {
  if (!(interval_s > 0.0 && interval_s <= kGap_s)) return;
  if (latest_s_.size() == kMost) latest_s_.erase(latest_s_.begin());
  latest_s_.push_back(interval_s);
}

double FrameIntervals::usual() const {
  if (latest_s_.size() < 2) return 0.0;
  std::vector<double> sorted_s = latest_s_;
  std::sort(sorted_s.begin(), sorted_s.end());
  const double most_s = kMostTimesMedian * sorted_s[sorted_s.size() / 2];
  sorted_s.pop_back();
  double sum_s = 0.0;
  for (const double interval_s : sorted_s) sum_s += std::min(interval_s, most_s);
  return sum_s / static_cast<double>(sorted_s.size());
}

double FrameIntervals::between(std::int64_t earlier_ns, std::int64_t later_ns) const {
  return std::max(toSeconds(later_ns - earlier_ns), 0.5 * usual());
}

}  // namespace point_line_odometry
