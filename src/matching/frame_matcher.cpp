#include "matching/frame_matcher.h"

#include <cmath>

#include "matching/line_matcher.h"
#include "matching/point_matcher.h"

namespace point_line_odometry {
namespace {

/// By how many rows a pixel of the right image must be moved.
float rowShift(const Eigen::Vector2f& right_px, const StereoCorrection& correction) {
  const Eigen::Vector2d pixel = right_px.cast<double>();
  return static_cast<float>(std::round(correction.apply(pixel).y() - pixel.y()));
}

}  // namespace

StereoMatches matchStereo(const DetectedFeatures& features, const StereoCorrection& correction,
                          const MatchingParameters& parameters, ThreadPool* threads) {
  StereoMatches matches;
  matches.points = matchPointsStereo(
      features.points_left, onCorrectRows(features.points_right, correction), parameters, threads);
  matches.lines = matchLinesStereo(
      features.lines_left, onCorrectRows(features.lines_right, correction), parameters, threads);
  return matches;
}

std::vector<Keypoint> onCorrectRows(std::vector<Keypoint> right,
                                    const StereoCorrection& correction) {
  for (Keypoint& point : right) point.pixel.y() += rowShift(point.pixel, correction);
  return right;
}

std::vector<LineFeature> onCorrectRows(std::vector<LineFeature> right,
                                       const StereoCorrection& correction) {
  for (LineFeature& line : right) {
    const float shift = rowShift(line.segment.middle(), correction);
    line.segment.start.y() += shift;
    line.segment.end.y() += shift;
  }
  return right;
}

CircularMatches matchCircular(const StereoFrame& prev, const StereoFrame& curr,
                              const StereoCamera& camera, const MotionPrediction& prediction,
                              const MatchingParameters& parameters, ThreadPool* threads) {
  return {matchPointsCircular(prev, curr, camera, prediction, parameters, threads),
          matchLinesCircular(prev, curr, camera, prediction, parameters, threads)};
}

}  // namespace point_line_odometry
