#include "odometry/correspondences.h"

#include <cmath>

namespace point_line_odometry {
namespace {

/// Noise of a point's pixel: that of the finest level, scaled to its own.
double pointSigma(const PointFeature& feature, const Parameters& parameters) {
  return parameters.motion.point_noise_px *
         std::pow(parameters.points.scale_factor, feature.octave);
}

LineTriangulationLimits lineLimits(const Parameters& parameters) {
  LineTriangulationLimits limits;
  limits.min_angle_rad = parameters.motion.min_line_angle_deg * M_PI / 180.0;
  limits.min_disparity_px = parameters.matching.min_disparity_px;
  limits.max_disparity_px = parameters.matching.max_disparity_px;
  return limits;
}

LineSegment corrected(const LineSegment& right, const RightImageCorrection& correction) {
  return {correction.apply(right.start.cast<double>()).cast<float>(),
          correction.apply(right.end.cast<double>()).cast<float>()};
}

/// A stereo point, or nothing if it has no disparity.
std::optional<StereoPoint> triangulate(const TriangulationInput& input,
                                       const DetectedFeatures& features, const IndexPair& match) {
  const PointFeature& left = features.points_left[match.first];
  const MatchingParameters& matching = input.parameters.matching;
  Eigen::Vector2f right_px = features.points_right[match.second].pixel;
  if (matching.refine_subpixel) {
    const auto aligned =
        PatchAligner(input.images.left, left.pixel).align(input.images.right, right_px);
    if (!aligned) return std::nullopt;
    right_px = *aligned;
  }
  const Eigen::Vector2d corrected = input.correction.apply(right_px.cast<double>());
  const auto triangulated =
      triangulatePoint(input.camera, left.pixel.cast<double>(), corrected.x(),
                       pointSigma(left, input.parameters), matching.min_disparity_px);
  if (!triangulated) return std::nullopt;
  return StereoPoint{match.first, match.second, right_px, *triangulated};
}

}  // namespace

void triangulateMatches(const TriangulationInput& input, ThreadPool* threads, StereoFrame* frame) {
  const DetectedFeatures& features = frame->features;
  std::vector<std::vector<StereoPoint>> parts(static_cast<std::size_t>(threads->numThreads()));
  const std::vector<IndexPair>& points = input.matches.points;
  threads->runParts(points.size(), [&](int part, std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      const std::optional<StereoPoint> point = triangulate(input, features, points[i]);
      if (point) parts[static_cast<std::size_t>(part)].push_back(*point);
    }
  });
  for (const std::vector<StereoPoint>& part : parts)
    frame->points.insert(frame->points.end(), part.begin(), part.end());

  const LineTriangulationLimits limits = lineLimits(input.parameters);
  for (const IndexPair& match : input.matches.lines) {
    const LineSegment& left = features.lines_left[match.first].segment;
    const LineSegment right =
        corrected(features.lines_right[match.second].segment, input.correction);
    frame->lines.push_back({match.first, match.second,
                            triangulateLine(input.camera, left, right,
                                            input.parameters.motion.line_noise_px, limits)});
  }
}

Correspondences makeCorrespondences(const StereoFrame& earlier, const StereoFrame& curr,
                                    const StereoImages& images, const CircularMatches& matches,
                                    const RightImageCorrection& correction,
                                    const Parameters& parameters) {
  Correspondences correspondences;
  correspondences.points.reserve(matches.points.size());
  correspondences.lines.reserve(matches.lines.size());
  for (const IndexPair& match : matches.points) {
    const StereoPoint& before = earlier.points[match.first];
    const StereoPoint& now = curr.points[match.second];
    const PointFeature& reference = earlier.features.points_left[before.left];
    Eigen::Vector2f left_px = curr.features.points_left[now.left].pixel;
    Eigen::Vector2f right_px = curr.features.points_right[now.right].pixel;
    if (parameters.matching.refine_subpixel) {
      const PatchAligner patch(earlier.left_image, reference.pixel);
      left_px = patch.align(images.left, left_px).value_or(left_px);
      right_px = patch.align(images.right, right_px).value_or(right_px);
    }
    PointCorrespondence point;
    point.p_prev = before.triangulated.p_camera;
    point.covariance = before.triangulated.covariance;
    point.left_px = left_px.cast<double>();
    point.right_px = correction.apply(right_px.cast<double>());
    point.sigma_px = pointSigma(reference, parameters);
    correspondences.points.push_back(point);
  }
  for (const IndexPair& match : matches.lines) {
    const StereoLine& before = earlier.lines[match.first];
    const LineSegment& left = curr.features.lines_left[curr.lines[match.second].left].segment;
    const LineSegment right =
        corrected(curr.features.lines_right[curr.lines[match.second].right].segment, correction);
    LineCorrespondence line;
    line.start_prev = before.triangulated->start_camera;
    line.end_prev = before.triangulated->end_camera;
    line.covariance = before.triangulated->covariance;
    line.left_start_px = left.start.cast<double>();
    line.left_end_px = left.end.cast<double>();
    line.right_start_px = right.start.cast<double>();
    line.right_end_px = right.end.cast<double>();
    line.sigma_px = parameters.motion.line_noise_px;
    correspondences.lines.push_back(line);
  }
  return correspondences;
}

FrameCounts countFeatures(const StereoFrame& frame) {
  FrameCounts counts;
  counts.points_left = static_cast<int>(frame.features.points_left.size());
  counts.points_right = static_cast<int>(frame.features.points_right.size());
  counts.lines_left = static_cast<int>(frame.features.lines_left.size());
  counts.lines_right = static_cast<int>(frame.features.lines_right.size());
  counts.point_stereo_matches = static_cast<int>(frame.points.size());
  counts.line_stereo_matches = static_cast<int>(frame.lines.size());
  for (const StereoLine& line : frame.lines)
    counts.lines_not_triangulable += line.triangulated ? 0 : 1;
  return counts;
}

void observeFeatures(const StereoFrame& curr, const CircularMatches& matches,
                     const MotionEstimate& motion, FrameResult* result) {
  std::vector<bool> point_shown(curr.features.points_left.size(), false);
  std::vector<bool> line_shown(curr.features.lines_left.size(), false);
  for (std::size_t i = 0; i < matches.points.size(); ++i) {
    const StereoPoint& point = curr.points[matches.points[i].second];
    point_shown[point.left] = true;
    result->points.push_back(
        {curr.features.points_left[point.left].pixel, curr.features.points_right[point.right].pixel,
         point.triangulated.p_camera.cast<float>(), bool(motion.point_inliers[i])});
  }
  for (std::size_t i = 0; i < matches.lines.size(); ++i) {
    const StereoLine& line = curr.lines[matches.lines[i].second];
    if (!line.triangulated) continue;
    line_shown[line.left] = true;
    result->lines.push_back(
        {curr.features.lines_left[line.left].segment, curr.features.lines_right[line.right].segment,
         line.triangulated->start_camera.cast<float>(), line.triangulated->end_camera.cast<float>(),
         bool(motion.line_inliers[i])});
  }
  for (std::size_t i = 0; i < point_shown.size(); ++i) {
    if (!point_shown[i]) result->unmatched_points_px.push_back(curr.features.points_left[i].pixel);
  }
  for (std::size_t i = 0; i < line_shown.size(); ++i) {
    if (!line_shown[i]) result->unmatched_lines_px.push_back(curr.features.lines_left[i].segment);
  }
}

}  // namespace point_line_odometry
