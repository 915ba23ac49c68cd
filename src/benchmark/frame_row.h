#pragma once

#include "benchmark/inputs.h"
#include "point_line_odometry/parameters.h"

namespace point_line_odometry {

/// Registers a row like registerStageRows(): the whole odometry over consecutive frames, on
/// tracking/threads threads. Counters of RowTimer, and the mean of each stage [ms].
void registerFrameRow(BenchmarkInput* input, const Parameters& parameters);

}  // namespace point_line_odometry
