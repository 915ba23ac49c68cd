#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "common/thread_pool.h"
#include "features/features.h"
#include "matching/expected_features.h"
#include "matching/index_pair.h"
#include "matching/stereo_frame.h"
#include "point_line_odometry/parameters.h"
#include "point_line_odometry/stereo_camera.h"

namespace point_line_odometry {

/// Pairs of segments (left, right) of similar direction that share rows, with ratio test and
/// cross-check of their descriptors.
std::vector<IndexPair> matchLinesStereo(const std::vector<LineFeature>& left,
                                        const std::vector<LineFeature>& right,
                                        const MatchingParameters& parameters,
                                        ThreadPool* threads = nullptr);

/// The predicted segments of a line by its end points in the current left camera [m]; descriptors
/// are left to the caller. Nothing if it is behind the camera or outside the left image and a
/// margin.
std::optional<ExpectedLine> expectLine(const StereoCamera& camera, const Eigen::Vector3d& start,
                                       const Eigen::Vector3d& end, double margin_px);

/// Pairs (expected, stereo line of frame k) like those of matchExpectedPoints(), with the
/// appearance-geometry constraint (paper, section 3).
std::vector<IndexPair> matchExpectedLines(const std::vector<ExpectedLine>& expected,
                                          const StereoFrame& curr, double radius_px,
                                          const MatchingParameters& parameters,
                                          ThreadPool* threads = nullptr);

/// Pairs of stereo lines (k-1, k) like those of matchPointsCircular(), of those that are
/// triangulated in frame k-1; with the appearance-geometry constraint (paper, section 3).
std::vector<IndexPair> matchLinesCircular(const StereoFrame& prev, const StereoFrame& curr,
                                          const StereoCamera& camera,
                                          const MotionPrediction& prediction,
                                          const MatchingParameters& parameters,
                                          ThreadPool* threads = nullptr);

}  // namespace point_line_odometry
