#include "ros/bounded_wait.h"

namespace point_line_odometry {
namespace {

constexpr std::chrono::milliseconds kMaxWait{100};
constexpr int kMaxLate = 3;
constexpr int kRetryPeriod = 20;  // frames

}  // namespace

std::chrono::steady_clock::time_point BoundedWait::end() const {
  const auto now = std::chrono::steady_clock::now();
  const bool waits = late_ < kMaxLate || late_ % kRetryPeriod == 0;
  return waits ? now + kMaxWait : now;
}

}  // namespace point_line_odometry
