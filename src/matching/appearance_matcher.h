#pragma once

#include <vector>

#include "features/features.h"
#include "matching/index_pair.h"
#include "matching/stereo_frame.h"
#include "point_line_odometry/parameters.h"

namespace point_line_odometry {

/// Pairs (known, stereo point of frame k) of the nearest descriptors over the whole image, without
/// a motion prediction: sum of the left and right Hamming distances, ratio test and cross-check.
std::vector<IndexPair> matchPointsByAppearance(const std::vector<StereoDescriptor>& known,
                                               const StereoFrame& curr,
                                               const MatchingParameters& parameters);

/// The descriptors of the stereo points of a frame.
std::vector<StereoDescriptor> stereoDescriptors(const StereoFrame& frame);

}  // namespace point_line_odometry
