#pragma once

#include "benchmark/inputs.h"
#include "point_line_odometry/parameters.h"

namespace point_line_odometry {

/// Registers rows of the benchmark, named INPUT/WHAT, with times in ms: OpenCV's detectors and each
/// stage of the odometry on one frame, with the counters of RowTimer. All run on one thread, except
/// for the detection of features in both images. \param input,parameters must outlive the run.
void registerStageRows(BenchmarkInput* input, const Parameters& parameters);

}  // namespace point_line_odometry
