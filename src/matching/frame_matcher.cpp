#include "matching/frame_matcher.h"

#include "matching/line_matcher.h"
#include "matching/point_matcher.h"

namespace point_line_odometry {

StereoMatches matchStereo(const DetectedFeatures& features, const MatchingParameters& parameters,
                          ThreadPool* threads) {
  StereoMatches matches;
  matches.points =
      matchPointsStereo(features.points_left, features.points_right, parameters, threads);
  matches.lines = matchLinesStereo(features.lines_left, features.lines_right, parameters, threads);
  return matches;
}

CircularMatches matchCircular(const StereoFrame& prev, const StereoFrame& curr,
                              const StereoCamera& camera, const MotionPrediction& prediction,
                              const MatchingParameters& parameters, ThreadPool* threads) {
  return {matchPointsCircular(prev, curr, camera, prediction, parameters, threads),
          matchLinesCircular(prev, curr, camera, prediction, parameters, threads)};
}

}  // namespace point_line_odometry
