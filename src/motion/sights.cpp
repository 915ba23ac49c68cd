#include "motion/sights.h"

#include <algorithm>
#include <cmath>

namespace point_line_odometry {

double pointSigma(const FrameContext& context, double alignment_noise_px, double scale) {
  const double by_parameters =
      scale * std::hypot(context.parameters.motion.point_noise_px, alignment_noise_px);
  return std::sqrt(context.noise.point_variance) * by_parameters;
}

double lineSigma(const FrameContext& context, const LineSegment& left, const LineSegment& right) {
  const MotionParameters& motion = context.parameters.motion;
  const double length_px = std::min(left.length(), right.length());
  const double by_parameters = std::hypot(
      motion.line_noise_px, 2.0 * motion.edge_noise_px / std::sqrt(std::max(length_px, 1.0)));
  return std::sqrt(context.noise.line_variance) * by_parameters;
}

LineSight lineSight(const DetectedFeatures& features, const StereoLine& line,
                    const FrameContext& context) {
  const LineSegment& left = features.lines_left[line.left].segment;
  const LineSegment& right = features.lines_right[line.right].segment;
  LineSight sight;
  sight.left_start_px = left.start.cast<double>();
  sight.left_end_px = left.end.cast<double>();
  sight.right_start_px = context.correction.apply(right.start.cast<double>());
  sight.right_end_px = context.correction.apply(right.end.cast<double>());
  sight.sigma_px = lineSigma(context, left, right);
  return sight;
}

std::optional<PointSight> alignPoint(const StereoPatch& patch, const Eigen::Vector2f& left_px,
                                     const Eigen::Vector2f& right_px, const FrameContext& context) {
  const auto left = patch.left.align(context.images.left, left_px);
  if (!left) return std::nullopt;
  const auto right = patch.right.align(context.images.right, right_px);
  const double max_rows = context.parameters.matching.max_row_difference_px;
  if (!right || std::abs(right->pixel.y() - left->pixel.y()) > max_rows) return std::nullopt;
  PointSight sight;
  sight.left_px = left->pixel.cast<double>();
  sight.right_px = context.correction.apply(right->pixel.cast<double>());
  sight.sigma_px = pointSigma(context, std::max(left->noise_px, right->noise_px), 1.0);
  return sight;
}

}  // namespace point_line_odometry
