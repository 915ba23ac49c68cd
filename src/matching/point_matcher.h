#pragma once

#include <vector>

#include "common/thread_pool.h"
#include "features/features.h"
#include "matching/expected_features.h"
#include "matching/index_pair.h"
#include "matching/stereo_frame.h"
#include "point_line_odometry/parameters.h"
#include "point_line_odometry/stereo_camera.h"

namespace point_line_odometry {

/// Pairs of points (left, right) within the epipolar window delta_u x delta_v, with ratio test and
/// cross-check of their descriptors.
std::vector<IndexPair> matchPointsStereo(const std::vector<Keypoint>& left,
                                         const std::vector<Keypoint>& right,
                                         const MatchingParameters& parameters, ThreadPool* threads);

/// Pairs (expected, stereo point of frame k) that agree in both directions: right(expected) ->
/// right(k) by the nearest descriptor within the search radius, left(k) -> left(expected) likewise.
std::vector<IndexPair> matchExpectedPoints(const std::vector<ExpectedPoint>& expected,
                                           const StereoFrame& curr, double radius_px,
                                           const MatchingParameters& parameters,
                                           ThreadPool* threads = nullptr);

/// Pairs of stereo points (k-1, k) whose circle l(k-1) -> r(k-1) -> r(k) -> l(k) -> l(k-1) closes
/// (paper, section 2): the matches within a frame are the stereo pairs, those between frames the
/// nearest descriptors around the predicted pixel (paper, eq. 1).
std::vector<IndexPair> matchPointsCircular(const StereoFrame& prev, const StereoFrame& curr,
                                           const StereoCamera& camera,
                                           const MotionPrediction& prediction,
                                           const MatchingParameters& parameters,
                                           ThreadPool* threads = nullptr);

}  // namespace point_line_odometry
