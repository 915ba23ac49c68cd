#include "motion/observations.h"

#include <algorithm>
#include <cmath>

namespace point_line_odometry {
namespace {

/// Moves the pixels of a point to where they would have been at the stamp. What their rows differ
/// by remains.
void toStamp(const FrameContext& context, Eigen::Vector2d* left_px, Eigen::Vector2d* right_px) {
  if (context.shutter.isGlobal()) return;
  const PixelWithDisparity at_stamp =
      context.shutter.atStamp(context.camera, {*left_px, left_px->x() - right_px->x()});
  right_px->x() = at_stamp.left_px.x() - at_stamp.disparity_px;
  right_px->y() += at_stamp.left_px.y() - left_px->y();
  *left_px = at_stamp.left_px;
}

Eigen::Vector2d middleOf(const Eigen::Vector2d& start, const Eigen::Vector2d& end) {
  return 0.5 * (start + end);
}

/// The pixel of a segment, prolonged by half at most, in the row of a pixel of the other image's
/// segment. Where it hardly changes rows, the pixel that is as far away as the middles are.
Eigen::Vector2d partnerOf(const Eigen::Vector2d& pixel, const Eigen::Vector2d& middle,
                          const Eigen::Vector2d& start, const Eigen::Vector2d& end) {
  constexpr double kLeastSlope = 0.1;  // rows by columns
  constexpr double kMostBeyond = 0.5;  // of the length
  const Eigen::Vector2d along = end - start;
  if (std::abs(along.y()) <= kLeastSlope * std::abs(along.x()))
    return {pixel.x() + middleOf(start, end).x() - middle.x(), pixel.y()};
  const double share = (pixel.y() - start.y()) / along.y();
  return {start.x() + std::clamp(share, -kMostBeyond, 1.0 + kMostBeyond) * along.x(), pixel.y()};
}

/// The same for the ends of a line's segments.
void toStamp(const FrameContext& context, LineObservation* line) {
  if (context.shutter.isGlobal()) return;
  const LineObservation seen = *line;
  const Eigen::Vector2d left_middle = middleOf(seen.left_start_px, seen.left_end_px);
  const Eigen::Vector2d right_middle = middleOf(seen.right_start_px, seen.right_end_px);
  for (const auto end : {&LineObservation::left_start_px, &LineObservation::left_end_px}) {
    Eigen::Vector2d right_px =
        partnerOf(seen.*end, left_middle, seen.right_start_px, seen.right_end_px);
    toStamp(context, &(line->*end), &right_px);
  }
  for (const auto end : {&LineObservation::right_start_px, &LineObservation::right_end_px}) {
    Eigen::Vector2d left_px =
        partnerOf(seen.*end, right_middle, seen.left_start_px, seen.left_end_px);
    toStamp(context, &left_px, &(line->*end));
  }
}

/// Standard deviation of a segment's end points along its normal [px]: the edge's deviation from a
/// straight line, and the noise of its pixels, about one for each pixel of length. The end points
/// of a line fitted to n samples of noise sigma have 2 sigma / sqrt(n). The shorter segment of a
/// stereo pair decides. \param scale of the pyramid level in whose pixels all this is.
double lineSigma(const FrameContext& context, const LineSegment& left, const LineSegment& right,
                 double scale) {
  const MotionParameters& motion = context.parameters.motion;
  const double length_px = std::min(left.length(), right.length()) / scale;
  const double by_parameters = std::hypot(
      motion.line_noise_px, 2.0 * motion.edge_noise_px / std::sqrt(std::max(length_px, 1.0)));
  return scale * std::sqrt(context.noise.line_variance) * by_parameters;
}

}  // namespace

double levelScale(const Keypoint& keypoint, const Parameters& parameters) {
  return std::pow(parameters.points.scale_factor, keypoint.octave);
}

double pointSigma(const FrameContext& context, double alignment_noise_px, double scale) {
  const double by_parameters =
      std::hypot(scale * context.parameters.motion.point_noise_px, alignment_noise_px);
  return std::sqrt(context.noise.point_variance) * by_parameters;
}

PointObservation pointObservation(const Eigen::Vector2f& left_px, const Eigen::Vector2f& right_px,
                                  double sigma_px, const FrameContext& context) {
  PointObservation observation{left_px.cast<double>(),
                               context.correction.apply(right_px.cast<double>()), sigma_px};
  toStamp(context, &observation.left_px, &observation.right_px);
  return observation;
}

LineObservation lineObservation(const LineSegment& left, const LineSegment& right, double scale,
                                const FrameContext& context) {
  LineObservation observation;
  observation.left_start_px = left.start.cast<double>();
  observation.left_end_px = left.end.cast<double>();
  observation.right_start_px = context.correction.apply(right.start.cast<double>());
  observation.right_end_px = context.correction.apply(right.end.cast<double>());
  observation.sigma_px = lineSigma(context, left, right, scale);
  toStamp(context, &observation);
  return observation;
}

LineObservation lineObservation(const DetectedFeatures& features, const StereoLine& line,
                                const FrameContext& context) {
  const LineFeature& left = features.lines_left[line.left];
  const LineFeature& right = features.lines_right[line.right];
  return lineObservation(left.segment, right.segment, std::max(left.scale, right.scale), context);
}

std::optional<AlignedPatch> alignInOctave(const PatchAligner& patch, const ImagePyramid& image,
                                          const FeatureMask& mask, int octave,
                                          const Eigen::Vector2f& initial_px) {
  const auto level = static_cast<std::size_t>(octave);
  if (level >= image.levels.size()) return std::nullopt;
  auto aligned = patch.align(image.levels[level], image.toLevel(initial_px, octave));
  if (!aligned || !mask.allowsPatch(aligned->pixel, octave)) return std::nullopt;
  aligned->pixel = image.fromLevel(aligned->pixel, octave);
  aligned->noise_px *= image.ratio(octave).maxCoeff();
  return aligned;
}

std::optional<PointObservation> alignPoint(const StereoPatch& patch, int octave,
                                           const Eigen::Vector2f& left_px,
                                           const Eigen::Vector2f& right_px,
                                           const FrameContext& context) {
  const auto left = alignInOctave(patch.left, context.left, context.masks.left, octave, left_px);
  if (!left) return std::nullopt;
  const auto right =
      alignInOctave(patch.right, context.right, context.masks.right, octave, right_px);
  const float scale = context.left.ratio(octave).maxCoeff();
  const double max_rows = scale * context.parameters.matching.max_row_difference_px;
  if (!right) return std::nullopt;
  const double sigma_px = pointSigma(context, std::max(left->noise_px, right->noise_px), scale);
  PointObservation observation = pointObservation(left->pixel, right->pixel, sigma_px, context);
  if (std::abs(observation.right_px.y() - observation.left_px.y()) > max_rows) return std::nullopt;
  observation.patch_px = scale * PatchAligner::kSide;
  return observation;
}

}  // namespace point_line_odometry
