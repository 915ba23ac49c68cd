#include "odometry/correspondences.h"

#include <algorithm>
#include <cmath>
#include <iterator>

#include "matching/patch_warp.h"

namespace point_line_odometry {
namespace {

double levelScale(const PointFeature& feature, const Parameters& parameters) {
  return std::pow(parameters.points.scale_factor, feature.octave);
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

/// A pixel of the left image in the right one, on a surface that need not face the cameras.
std::optional<AlignedPatch> alignStereo(const cv::Mat& left_image, const cv::Mat& right_image,
                                        const Eigen::Vector2f& left_px,
                                        const Eigen::Vector2f& right_px) {
  const PatchAligner patch(left_image, left_px);
  auto facing = patch.align(right_image, right_px);
  const auto slanted = patch.alignSlanted(right_image, facing ? facing->pixel : right_px);
  if (!slanted) return facing;
  // The next frames will look for the patch as it is seen there. Looked for in the same way, it is
  // found at the same place: the two ways differ by hundredths of a pixel, which are no motion.
  Eigen::Matrix2f right_by_left = Eigen::Matrix2f::Identity();
  right_by_left.row(0) += slanted->slope.transpose();
  const PatchAligner as_seen(left_image, left_px, right_by_left.inverse());
  auto seen = as_seen.align(right_image, slanted->pixel);
  if (seen) seen->slope = slanted->slope;
  return seen;
}

/// The same in the octave of the point; pixels are those of the images themselves.
std::optional<AlignedPatch> alignStereo(const FrameContext& context, const PointFeature& left,
                                        const PointFeature& right) {
  const int octave = left.octave;
  const auto level = static_cast<std::size_t>(octave);
  auto aligned = alignStereo(context.left.levels[level], context.right.levels[level],
                             context.left.toLevel(left.pixel, octave),
                             context.right.toLevel(right.pixel, octave));
  if (!aligned) return std::nullopt;
  aligned->pixel = context.right.fromLevel(aligned->pixel, octave);
  aligned->noise_px *= context.right.ratio(octave).maxCoeff();
  return aligned;
}

/// A stereo point, or nothing if the pair cannot be one.
std::optional<StereoPoint> triangulate(const DetectedFeatures& features, const IndexPair& match,
                                       const FrameContext& context) {
  const PointFeature& left = features.points_left[match.first];
  const MatchingParameters& matching = context.parameters.matching;
  AlignedPatch right{features.points_right[match.second].pixel};
  if (matching.refine_subpixel) {
    const auto found = alignStereo(context, left, features.points_right[match.second]);
    if (!found) return std::nullopt;
    right = *found;
  }
  const Eigen::Vector2d corrected = context.correction.apply(right.pixel.cast<double>());
  const double sigma_px = pointSigma(context, right.noise_px, levelScale(left, context.parameters));
  StereoPoint point;
  point.left = match.first;
  point.right = match.second;
  point.right_px = right.pixel;
  point.sigma_px = sigma_px;
  const Eigen::Vector2d left_px = left.pixel.cast<double>();
  const auto triangulated =
      triangulatePoint(context.camera, left_px, corrected.x(), sigma_px, matching.min_disparity_px);
  if (triangulated) {
    point.triangulated = *triangulated;
  } else {
    const double disparity_px = left_px.x() - corrected.x();
    // Weighted without its covariance, a far point would say that the camera does not move.
    if (!matching.keep_far_points || !context.parameters.motion.use_triangulation_covariance ||
        !(disparity_px >= -matching.max_row_difference_px))
      return std::nullopt;
    point.far = true;
    point.triangulated = triangulateFarPoint(context.camera, left_px, corrected.x(), sigma_px);
    right.slope.setZero();
  }
  point.pixel_axes = pixelAxes(context.camera, point.triangulated.p_camera, right.slope);
  return point;
}

/// The patch round a point of an earlier frame as both images of the current one should see it.
StereoPatch patchOf(const StereoFrame& earlier, const StereoPoint& point,
                    const Eigen::Isometry3d& T_curr_earlier, const StereoCamera& camera) {
  const PointFeature& feature = earlier.features.points_left[point.left];
  const cv::Mat& image = earlier.left_image.levels[static_cast<std::size_t>(feature.octave)];
  const Eigen::Vector2f pixel = earlier.left_image.toLevel(feature.pixel, feature.octave);
  const auto warp = stereoPatchWarp(camera, T_curr_earlier * point.triangulated.p_camera,
                                    T_curr_earlier.linear() * point.pixel_axes);
  if (warp) return StereoPatch(image, pixel, *warp);
  return StereoPatch(PatchAligner(image, pixel));
}

/// A point where it was detected: known to a whole pixel of its level.
AlignedPatch unaligned(const PointFeature& feature, const ImagePyramid& image) {
  AlignedPatch point{feature.pixel};
  point.noise_px *= image.ratio(feature.octave).maxCoeff();
  return point;
}

PointCorrespondence makeCorrespondence(const StereoFrame& earlier, const StereoPoint& before,
                                       const StereoFrame& curr, const StereoPoint& now,
                                       const Eigen::Isometry3d& T_curr_earlier,
                                       const FrameContext& context) {
  AlignedPatch left = unaligned(curr.features.points_left[now.left], context.left);
  AlignedPatch right = unaligned(curr.features.points_right[now.right], context.right);
  if (context.parameters.matching.refine_subpixel) {
    const StereoPatch patch = patchOf(earlier, before, T_curr_earlier, context.camera);
    const int octave = earlier.features.points_left[before.left].octave;
    left = alignInOctave(patch.left, context.left, octave, left.pixel).value_or(left);
    right = alignInOctave(patch.right, context.right, octave, right.pixel).value_or(right);
  }
  PointCorrespondence point;
  point.p_prev = before.triangulated.p_camera;
  point.far = before.far;
  point.covariance = before.triangulated.covariance;
  point.left_px = left.pixel.cast<double>();
  point.right_px = context.correction.apply(right.pixel.cast<double>());
  point.sigma_px =
      pointSigma(context, std::max(left.noise_px, right.noise_px),
                 levelScale(earlier.features.points_left[before.left], context.parameters));
  return point;
}

/// Appends the points of stereo matches that can be triangulated.
void triangulatePoints(const std::vector<IndexPair>& matches, const FrameContext& context,
                       ThreadPool* threads, StereoFrame* frame) {
  std::vector<std::vector<StereoPoint>> parts(static_cast<std::size_t>(threads->numThreads()));
  threads->runParts(matches.size(), [&](int part, std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      const std::optional<StereoPoint> point = triangulate(frame->features, matches[i], context);
      if (point) parts[static_cast<std::size_t>(part)].push_back(*point);
    }
  });
  for (const std::vector<StereoPoint>& part : parts)
    frame->points.insert(frame->points.end(), part.begin(), part.end());
}

}  // namespace

PointCoverage::PointCoverage(const StereoFrame& frame, const FrameContext& context)
    : cell_size_(static_cast<float>(context.parameters.points.cell_size_px)),
      columns_(static_cast<std::size_t>(frame.left_image.levels.front().cols /
                                        context.parameters.points.cell_size_px) +
               1),
      counts_(columns_ * (static_cast<std::size_t>(frame.left_image.levels.front().rows /
                                                   context.parameters.points.cell_size_px) +
                          1)) {
  for (const StereoPoint& point : frame.points) {
    if (!point.far) ++counts_[cellOf(frame.features.points_left[point.left].pixel)];
  }
}

std::size_t PointCoverage::cellOf(const Eigen::Vector2f& pixel) const {
  return static_cast<std::size_t>(pixel.y() / cell_size_) * columns_ +
         static_cast<std::size_t>(pixel.x() / cell_size_);
}

bool PointCoverage::isPoor() const {
  constexpr double kManyCells =
      0.6;  // half the cells are short where there is sky and a plain road
  const auto few = std::count_if(counts_.begin(), counts_.end(), [](int n) { return n < kFew; });
  return static_cast<double>(few) > kManyCells * static_cast<double>(counts_.size());
}

bool hasCoarserPoints(const StereoFrame& frame) {
  return std::any_of(frame.points.begin(), frame.points.end(), [&](const StereoPoint& point) {
    return frame.features.points_left[point.left].octave > 0;
  });
}

void addCoarserPoints(const DetectedFeatures& coarser, const PointCoverage& coverage,
                      const FrameContext& context, ThreadPool* threads, StereoFrame* frame) {
  DetectedFeatures& features = frame->features;
  const auto first_left = static_cast<int>(features.points_left.size());
  const auto first_right = static_cast<int>(features.points_right.size());
  std::vector<PointFeature> left;
  std::copy_if(coarser.points_left.begin(), coarser.points_left.end(), std::back_inserter(left),
               [&](const PointFeature& point) { return coverage.isShortAt(point.pixel); });
  std::vector<IndexPair> pairs =
      matchPointsStereo(left, coarser.points_right, context.parameters.matching, threads);
  for (IndexPair& pair : pairs) pair = {first_left + pair.first, first_right + pair.second};
  features.points_left.insert(features.points_left.end(), left.begin(), left.end());
  features.points_right.insert(features.points_right.end(), coarser.points_right.begin(),
                               coarser.points_right.end());
  triangulatePoints(pairs, context, threads, frame);
}

void triangulateMatches(const StereoMatches& matches, const FrameContext& context,
                        ThreadPool* threads, StereoFrame* frame) {
  const DetectedFeatures& features = frame->features;
  triangulatePoints(matches.points, context, threads, frame);

  const LineTriangulationLimits limits = lineLimits(context.parameters);
  for (const IndexPair& match : matches.lines) {
    const LineSegment& left = features.lines_left[match.first].segment;
    const LineSegment right =
        corrected(features.lines_right[match.second].segment, context.correction);
    const double sigma_px = lineSigma(context, left, right);
    frame->lines.push_back({match.first, match.second,
                            triangulateLine(context.camera, left, right, sigma_px, limits)});
  }
}

Correspondences makeCorrespondences(const StereoFrame& earlier, const StereoFrame& curr,
                                    const CircularMatches& matches,
                                    const Eigen::Isometry3d& T_curr_earlier,
                                    const FrameContext& context, ThreadPool* threads) {
  Correspondences correspondences;
  correspondences.points.resize(matches.points.size());
  const auto make_points = [&](int, std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      const StereoPoint& before = earlier.points[matches.points[i].first];
      const StereoPoint& now = curr.points[matches.points[i].second];
      correspondences.points[i] =
          makeCorrespondence(earlier, before, curr, now, T_curr_earlier, context);
    }
  };
  if (threads != nullptr) {
    threads->runParts(matches.points.size(), make_points);
  } else {
    make_points(0, 0, matches.points.size());
  }
  correspondences.lines.reserve(matches.lines.size());
  for (const IndexPair& match : matches.lines) {
    const StereoLine& before = earlier.lines[match.first];
    LineCorrespondence line;
    static_cast<LineSight&>(line) = lineSight(curr.features, curr.lines[match.second], context);
    line.start_prev = before.triangulated->start_camera;
    line.end_prev = before.triangulated->end_camera;
    line.covariance = before.triangulated->covariance;
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
    if (point.far) continue;  // it has no place that could be shown
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
