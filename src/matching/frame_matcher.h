#pragma once

#include <vector>

#include "common/thread_pool.h"
#include "features/features.h"
#include "matching/expected_features.h"
#include "matching/index_pair.h"
#include "matching/stereo_frame.h"
#include "point_line_odometry/parameters.h"
#include "point_line_odometry/stereo_camera.h"
#include "point_line_odometry/stereo_correction.h"

namespace point_line_odometry {

/// Pairs (left, right) of features of one stereo frame.
struct StereoMatches {
  std::vector<IndexPair> points;
  std::vector<IndexPair> lines;
};

/// Points by matchPointsStereo() and lines by matchLinesStereo(), on the rows of a correctly
/// calibrated right camera.
StereoMatches matchStereo(const DetectedFeatures& features, const StereoCorrection& correction,
                          const MatchingParameters& parameters, ThreadPool* threads);

/// Features of the right image on the rows of a correctly calibrated camera, to whole pixels:
/// corners lie on these, and by a fraction a window would lose one of its rows.
std::vector<Keypoint> onCorrectRows(std::vector<Keypoint> right,
                                    const StereoCorrection& correction);
std::vector<LineFeature> onCorrectRows(std::vector<LineFeature> right,
                                       const StereoCorrection& correction);

/// Pairs (k-1, k) of stereo points and of stereo lines.
struct CircularMatches {
  std::vector<IndexPair> points;
  std::vector<IndexPair> lines;
};

/// Points by matchPointsCircular() and lines by matchLinesCircular(). \param threads may be null.
CircularMatches matchCircular(const StereoFrame& prev, const StereoFrame& curr,
                              const StereoCamera& camera, const MotionPrediction& prediction,
                              const MatchingParameters& parameters, ThreadPool* threads = nullptr);

}  // namespace point_line_odometry
