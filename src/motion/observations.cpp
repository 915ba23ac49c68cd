#include "motion/observations.h"

#include <algorithm>
#include <cmath>

namespace point_line_odometry {

double levelScale(const Keypoint& keypoint, const Parameters& parameters) {
  return std::pow(parameters.points.scale_factor, keypoint.octave);
}

double pointSigma(const FrameContext& context, double alignment_noise_px, double scale) {
  const double by_parameters =
      std::hypot(scale * context.parameters.motion.point_noise_px, alignment_noise_px);
  return std::sqrt(context.noise.point_variance) * by_parameters;
}

double lineSigma(const FrameContext& context, const LineSegment& left, const LineSegment& right,
                 double scale) {
  const MotionParameters& motion = context.parameters.motion;
  const double length_px = std::min(left.length(), right.length()) / scale;
  const double by_parameters = std::hypot(
      motion.line_noise_px, 2.0 * motion.edge_noise_px / std::sqrt(std::max(length_px, 1.0)));
  return scale * std::sqrt(context.noise.line_variance) * by_parameters;
}

PointObservation pointObservation(const Eigen::Vector2f& left_px, const Eigen::Vector2f& right_px,
                                  double sigma_px, const StereoCorrection& correction) {
  return {left_px.cast<double>(), correction.apply(right_px.cast<double>()), sigma_px};
}

LineObservation lineObservation(const DetectedFeatures& features, const StereoLine& line,
                                const FrameContext& context) {
  const LineSegment& left = features.lines_left[line.left].segment;
  const LineSegment& right = features.lines_right[line.right].segment;
  LineObservation observation;
  observation.left_start_px = left.start.cast<double>();
  observation.left_end_px = left.end.cast<double>();
  observation.right_start_px = context.correction.apply(right.start.cast<double>());
  observation.right_end_px = context.correction.apply(right.end.cast<double>());
  observation.sigma_px = lineSigma(context, left, right, features.lines_left[line.left].scale);
  return observation;
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
  PointObservation observation =
      pointObservation(left->pixel, right->pixel, sigma_px, context.correction);
  if (std::abs(observation.right_px.y() - observation.left_px.y()) > max_rows) return std::nullopt;
  observation.patch_px = scale * PatchAligner::kSide;
  return observation;
}

}  // namespace point_line_odometry
