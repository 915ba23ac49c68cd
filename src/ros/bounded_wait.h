#pragma once

#include <chrono>

namespace point_line_odometry {

/// How long a frame waits for another source: a bounded time. One that has been too late for
/// several frames in a row is tried again only now and then, so that it cannot hold up the images.
class BoundedWait {
 public:
  /// When to stop waiting, from now on.
  std::chrono::steady_clock::time_point end() const;

  /// \param in_time whether what was waited for has come.
  void note(bool in_time) { late_ = in_time ? 0 : late_ + 1; }

 private:
  int late_ = 0;  // frames in a row
};

}  // namespace point_line_odometry
