#include "odometry/stereo_triangulation.h"

#include <cmath>
#include <optional>
#include <utility>

#include "geometry/triangulation.h"
#include "matching/patch_aligner.h"
#include "matching/patch_warp.h"
#include "motion/observations.h"

namespace point_line_odometry {
namespace {

LineTriangulationLimits lineLimits(const Parameters& parameters) {
  LineTriangulationLimits limits;
  limits.min_angle_rad = parameters.motion.min_line_angle_deg * M_PI / 180.0;
  limits.min_disparity_px = parameters.matching.min_disparity_px;
  limits.max_disparity_px = parameters.matching.max_disparity_px;
  return limits;
}

/// Aligns the patch around a left pixel in the right image, on a plane that need not be parallel to
/// the images.
std::optional<AlignedPatch> alignStereo(const cv::Mat& left_image, const cv::Mat& right_image,
                                        const Eigen::Vector2f& left_px,
                                        const Eigen::Vector2f& right_px) {
  const PatchAligner patch(left_image, left_px);
  auto facing = patch.align(right_image, right_px);
  const auto slanted = patch.alignSlanted(right_image, facing ? facing->pixel : right_px);
  if (!slanted) return facing;
  // The next frames align a warped patch by translation. Done the same way here, their biases
  // cancel: the two kinds of alignment differ by hundredths of a pixel, which would pass for a
  // motion.
  Eigen::Matrix2f J_right_left = Eigen::Matrix2f::Identity();
  J_right_left.row(0) += slanted->slope.transpose();
  const PatchAligner warped(left_image, left_px, J_right_left.inverse());
  auto aligned = warped.align(right_image, slanted->pixel);
  if (aligned) aligned->slope = slanted->slope;
  return aligned;
}

/// The same in the octave of the point; pixels are those of the full-resolution images.
std::optional<AlignedPatch> alignStereo(const FrameContext& context, const Keypoint& left,
                                        const Keypoint& right) {
  const int octave = left.octave;
  const auto level = static_cast<std::size_t>(octave);
  auto aligned = alignStereo(context.left.levels[level], context.right.levels[level],
                             context.left.toLevel(left.pixel, octave),
                             context.right.toLevel(right.pixel, octave));
  if (!aligned || !context.masks.right.allowsPatch(aligned->pixel, octave)) return std::nullopt;
  aligned->pixel = context.right.fromLevel(aligned->pixel, octave);
  aligned->noise_px *= context.right.ratio(octave).maxCoeff();
  return aligned;
}

/// The stereo point of a match, without a position; nothing if its patch is not found.
std::optional<StereoPoint> align(const DetectedFeatures& features, const IndexPair& match,
                                 const FrameContext& context) {
  const Keypoint& left = features.points_left[match.first];
  const Keypoint& right = features.points_right[match.second];
  AlignedPatch aligned{right.pixel};
  if (context.parameters.matching.refine_subpixel) {
    const auto found = alignStereo(context, left, right);
    if (!found) return std::nullopt;
    aligned = *found;
  }
  StereoPoint point;
  point.left = match.first;
  point.right = match.second;
  point.right_px = aligned.pixel;
  point.slope = aligned.slope;
  point.sigma_px = pointSigma(context, aligned.noise_px, levelScale(left, context.parameters));
  return point;
}

/// Locates an aligned point of a frame at the stamp. False if it cannot be a stereo point.
bool triangulate(const StereoFrame& frame, const FrameContext& context, StereoPoint* point) {
  const Keypoint& left = frame.features.points_left[point->left];
  const MatchingParameters& matching = context.parameters.matching;
  const PointObservation seen =
      pointObservation(left.pixel, point->right_px, point->sigma_px, context);
  const Eigen::Vector2d& left_px = seen.left_px;
  const double right_u_px = seen.right_px.x();
  // A disparity of less than a pixel of its level is noise.
  const double min_disparity_px =
      matching.min_disparity_px * frame.left_image.ratio(left.octave).maxCoeff();
  const auto triangulated =
      triangulatePoint(context.camera, left_px, right_u_px, point->sigma_px, min_disparity_px);
  point->far = !triangulated;
  if (triangulated) {
    point->triangulated = *triangulated;
    return true;
  }
  // Without its covariance, a far point would constrain the translation to zero.
  if (!matching.keep_far_points || !context.parameters.motion.use_triangulation_covariance ||
      !(left_px.x() - right_u_px >= -matching.max_row_difference_px))
    return false;
  point->triangulated = triangulateFarPoint(context.camera, left_px, right_u_px, point->sigma_px);
  return true;
}

}  // namespace

void triangulatePoints(const std::vector<IndexPair>& matches, const FrameContext& context,
                       ThreadPool* threads, StereoFrame* frame) {
  std::vector<std::vector<StereoPoint>> parts(static_cast<std::size_t>(threads->numParts()));
  threads->runParts(matches.size(), [&](int part, std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      std::optional<StereoPoint> point = align(frame->features, matches[i], context);
      if (point && triangulate(*frame, context, &*point))
        parts[static_cast<std::size_t>(part)].push_back(*point);
    }
  });
  for (const std::vector<StereoPoint>& part : parts)
    frame->points.insert(frame->points.end(), part.begin(), part.end());
}

void triangulateLines(const std::vector<IndexPair>& matches, const FrameContext& context,
                      StereoFrame* frame) {
  for (const IndexPair& match : matches) {
    StereoLine line{match.first, match.second, std::nullopt};
    line.triangulated =
        triangulateObservation(lineObservation(frame->features, line, context), context);
    frame->lines.push_back(line);
  }
}

std::optional<TriangulatedLine> triangulateObservation(const LineObservation& seen,
                                                       const FrameContext& context) {
  return triangulateLine(context.camera,
                         {seen.left_start_px.cast<float>(), seen.left_end_px.cast<float>()},
                         {seen.right_start_px.cast<float>(), seen.right_end_px.cast<float>()},
                         seen.sigma_px, lineLimits(context.parameters));
}

void triangulateMatches(const StereoMatches& matches, const FrameContext& context,
                        ThreadPool* threads, StereoFrame* frame) {
  frame->correction = context.correction;
  frame->shutter = context.shutter;
  triangulatePoints(matches.points, context, threads, frame);
  triangulateLines(matches.lines, context, frame);
}

void triangulateAgain(const FrameContext& context, StereoFrame* frame) {
  frame->correction = context.correction;
  frame->shutter = context.shutter;
  for (std::vector<StereoPoint>* points : {&frame->points, &frame->resting_points}) {
    std::vector<StereoPoint> located;
    located.reserve(points->size());
    for (StereoPoint& point : *points) {
      if (triangulate(*frame, context, &point)) located.push_back(point);
    }
    *points = std::move(located);
  }
  for (StereoLine& line : frame->lines)
    line.triangulated =
        triangulateObservation(lineObservation(frame->features, line, context), context);
}

}  // namespace point_line_odometry
