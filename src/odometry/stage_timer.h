#pragma once

#include <chrono>

#include "point_line_odometry/frame_result.h"

namespace point_line_odometry {

/// Adds the time of its lifetime to a stage.
class StageTimer {
 public:
  StageTimer(StageTimes* times, Stage stage) : ms_(&times->ms[static_cast<std::size_t>(stage)]) {}
  StageTimer(const StageTimer&) = delete;
  StageTimer& operator=(const StageTimer&) = delete;
  ~StageTimer() { *ms_ += elapsedMs(begin_); }

  using Clock = std::chrono::steady_clock;
  static double elapsedMs(Clock::time_point begin) {
    return std::chrono::duration<double, std::milli>(Clock::now() - begin).count();
  }

 private:
  double* ms_;
  Clock::time_point begin_ = Clock::now();
};

}  // namespace point_line_odometry
