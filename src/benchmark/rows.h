#pragma once

/// \file
/// The rows of the benchmark: each function registers those of one input with Google Benchmark. A
/// row is named INPUT/WHAT; times are in ms. Input and parameters must outlive the run.

#include "benchmark/inputs.h"
#include "point_line_odometry/parameters.h"

namespace point_line_odometry {

/// OpenCV's detectors and each stage of the odometry on one frame, the counters of RowTimer. All
/// run on one thread, except for the detection of features in both images.
void registerStageRows(BenchmarkInput* input, const Parameters& parameters);

/// The whole odometry over consecutive frames, on as many threads as tracking/threads says.
/// Counters of RowTimer, and the median of each stage [ms].
void registerFrameRow(BenchmarkInput* input, const Parameters& parameters);

/// How good the segments are, ours and those of OpenCV's detector, over pairs spread over the
/// sequence: all segments longer than 20 px, and the n longest of each, n the number of the one
/// that has fewer in that image. The time is that of a detection. Counters, per image: segments,
/// length_px (sum); over all: right and next (share found again in the right image, in the next
/// frame, of those that could be tracked there), right_tracked and next_tracked (share that could
/// be), offset_rms and offset_med (root mean square and median distance to the edge [px]), on_edge
/// (share of the segments' pixels that have one).
void registerQualityRows(BenchmarkInput* input, const Parameters& parameters);

}  // namespace point_line_odometry
