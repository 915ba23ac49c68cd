#pragma once

#include "benchmark/inputs.h"
#include "point_line_odometry/parameters.h"

namespace point_line_odometry {

/// Registers rows like registerStageRows(): quality of the segments, ours and those of OpenCV's
/// detector, on pairs sampled from the sequence: all segments longer than 20 px, and the n longest
/// of each, n the number of the one that has fewer in that image. The time is that of a detection.
/// Counters, per image: segments, length_px (sum); over all: right and next (share found again in
/// the right image, in the next frame, of those that could be tracked there), right_tracked and
/// next_tracked (share that could be), offset_rms and offset_med (root mean square and median
/// distance to the edge [px]), on_edge (share of the segments' pixels that have one).
void registerQualityRows(BenchmarkInput* input, const Parameters& parameters);

}  // namespace point_line_odometry
