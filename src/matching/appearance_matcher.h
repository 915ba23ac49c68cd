#pragma once

#include <vector>

#include "common/thread_pool.h"
#include "features/features.h"
#include "matching/index_pair.h"
#include "matching/stereo_frame.h"
#include "point_line_odometry/parameters.h"

namespace point_line_odometry {

/// Pairs (known, seen) of the nearest descriptors, wherever in the image they are: sum of the left
/// and right Hamming distances, ratio test and cross-check. \param threads or null.
std::vector<IndexPair> matchByAppearance(const std::vector<StereoDescriptor>& known,
                                         const std::vector<StereoDescriptor>& seen,
                                         const MatchingParameters& parameters,
                                         ThreadPool* threads = nullptr);

/// The descriptors of the stereo points of a frame.
std::vector<StereoDescriptor> stereoDescriptors(const StereoFrame& frame);

}  // namespace point_line_odometry
