#pragma once

#include <chrono>
#include <map>
#include <mutex>
#include <string>

namespace point_line_odometry {

/// Lets a message that would repeat into the log once in a period of real time. ROS_WARN_THROTTLE
/// goes by simulated time, which stands still where nobody publishes /clock, and takes all nodelets
/// of a manager together. Thread-safe.
class LogThrottle {
 public:
  /// Whether a message may be logged now. \param kind messages of another kind are not counted.
  bool passes(const std::string& kind, double period_s = 5.0) {
    const Clock::time_point now = Clock::now();
    const std::lock_guard<std::mutex> lock(mutex_);
    const auto [last, is_first] = last_.emplace(kind, now);
    if (!is_first && now - last->second < std::chrono::duration<double>(period_s)) return false;
    last->second = now;
    return true;
  }

 private:
  using Clock = std::chrono::steady_clock;

  std::mutex mutex_;
  std::map<std::string, Clock::time_point> last_;
};

}  // namespace point_line_odometry
