#include "odometry/stereo_triangulation.h"

#include <cmath>
#include <optional>

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

/// A stereo point, or nothing if the pair cannot be one.
std::optional<StereoPoint> triangulate(const DetectedFeatures& features, const IndexPair& match,
                                       const FrameContext& context) {
  const Keypoint& left = features.points_left[match.first];
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
  // A disparity of less than a pixel of its level is noise.
  const double min_disparity_px =
      matching.min_disparity_px * context.left.ratio(left.octave).maxCoeff();
  const auto triangulated =
      triangulatePoint(context.camera, left_px, corrected.x(), sigma_px, min_disparity_px);
  if (triangulated) {
    point.triangulated = *triangulated;
  } else {
    const double disparity_px = left_px.x() - corrected.x();
    // Without its covariance, a far point would constrain the translation to zero.
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

}  // namespace

void triangulatePoints(const std::vector<IndexPair>& matches, const FrameContext& context,
                       ThreadPool* threads, StereoFrame* frame) {
  std::vector<std::vector<StereoPoint>> parts(static_cast<std::size_t>(threads->numParts()));
  threads->runParts(matches.size(), [&](int part, std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      const std::optional<StereoPoint> point = triangulate(frame->features, matches[i], context);
      if (point) parts[static_cast<std::size_t>(part)].push_back(*point);
    }
  });
  for (const std::vector<StereoPoint>& part : parts)
    frame->points.insert(frame->points.end(), part.begin(), part.end());
}

void triangulateLines(const std::vector<IndexPair>& matches, const FrameContext& context,
                      StereoFrame* frame) {
  const DetectedFeatures& features = frame->features;
  const LineTriangulationLimits limits = lineLimits(context.parameters);
  for (const IndexPair& match : matches) {
    const LineFeature& left = features.lines_left[match.first];
    const LineSegment right = context.correction.apply(features.lines_right[match.second].segment);
    const double sigma_px = lineSigma(context, left.segment, right, left.scale);
    frame->lines.push_back(
        {match.first, match.second,
         triangulateLine(context.camera, left.segment, right, sigma_px, limits)});
  }
}

void triangulateMatches(const StereoMatches& matches, const FrameContext& context,
                        ThreadPool* threads, StereoFrame* frame) {
  triangulatePoints(matches.points, context, threads, frame);
  triangulateLines(matches.lines, context, frame);
}

}  // namespace point_line_odometry
