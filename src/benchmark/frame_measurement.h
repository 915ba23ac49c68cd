#pragma once

#include <array>
#include <cstddef>
#include <string>
#include <vector>

#include "benchmark/inputs.h"
#include "benchmark/row_timer.h"
#include "point_line_odometry/frame_result.h"
#include "point_line_odometry/parameters.h"

namespace point_line_odometry {

/// How the odometry is run.
struct RunKind {
  std::string name;
  Parameters parameters;
  int enlargement = 1;  ///< of width and height of the images
};

/// The times of frames [ms], keyframes included.
struct FrameTimes {
  RunKind kind;
  CallTimes frames;
  std::array<std::vector<double>, kNumStages> stages;

  /// Mean: frames that are tracked by landmarks alone take a part of the others' time.
  double mean_ms() const;
  double p95_ms() const;               ///< 95 % of the frames take less
  double cpu_ms() const;               ///< mean of the processor's in all threads
  double stage_ms(Stage stage) const;  ///< mean
};

/// Times of several kinds of runs of one sequence and, in between, of OpenCV's line segment
/// detector on one image.
struct SequenceTimes {
  std::vector<FrameTimes> runs;
  CallTimes yardstick;  ///< empty if this OpenCV has none

  /// Median of the detector's time [ms], 0 without it.
  double yardstick_ms() const;
  double yardstickCpu_ms() const;  ///< of the processor
};

/// Runs all kinds in turns, a few frames each and then the detector, three times over the input's
/// run; enlarged ones once.
SequenceTimes measureFrames(BenchmarkInput* input, const std::vector<RunKind>& kinds);

}  // namespace point_line_odometry
