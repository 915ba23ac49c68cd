#include "features/line_feature_detector.h"

#include <cstddef>

#include "common/area_reduction.h"
#include "features/edge_aligner.h"
#include "features/line_descriptor.h"

namespace point_line_odometry {
namespace {

constexpr int kHalfSize = 2;  // of a pixel

/// The least gradient stays: that of a sharp edge is the same in pixels twice as large.
LineDetector detectorAtHalfSize(LineParameters parameters) {
  parameters.min_length_px *= 0.5;
  parameters.max_deviation_px *= 0.5;
  return LineDetector(parameters, kHalfSize);
}

LineSegment fromHalfSize(const LineSegment& half_px) {
  const auto pixel = [](const Eigen::Vector2f& half) -> Eigen::Vector2f {
    return 2.0F * half + Eigen::Vector2f(0.5F, 0.5F);
  };
  return {pixel(half_px.start), pixel(half_px.end)};
}

}  // namespace

LineResolution lineResolutionAfter(std::size_t num_points, const LineParameters& parameters) {
  return num_points >= static_cast<std::size_t>(parameters.coarse_to_fine_points)
             ? LineResolution::kCoarseToFine
             : LineResolution::kFull;
}

LineFeatureDetector::LineFeatureDetector(const LineParameters& parameters, LineDetectorKind kind)
    : parameters_(parameters),
      kind_(kind),
      full_{1, LineDetector(parameters), {}},
      half_{kHalfSize, detectorAtHalfSize(parameters), {}} {
  if (kind == LineDetectorKind::kLsd) lsd_.emplace(parameters);
}

std::vector<LineFeature> LineFeatureDetector::detect(const cv::Mat& image,
                                                     LineResolution resolution,
                                                     const FeatureMask& mask) {
  if (kind_ == LineDetectorKind::kNone || image.cols < 2 || image.rows < 2) return {};
  if (resolution == LineResolution::kFull || lsd_) return detectAt(&full_, image, mask);
  halve(image, &half_image_);
  std::vector<LineFeature> lines = detectAt(&half_, half_image_, mask.half());
  for (LineFeature& line : lines) {
    const LineSegment found = fromHalfSize(line.segment);
    const std::optional<LineSegment> aligned = alignEdge(image, mask, found, parameters_);
    line.segment = aligned.value_or(found);
    line.scale = aligned ? 1.0F : 2.0F;
  }
  return lines;
}

std::vector<LineFeature> LineFeatureDetector::detectAt(Size* size, const cv::Mat& image,
                                                       const FeatureMask& mask) {
  GradientImage& gradient = size->gradient;
  computeGradient(image, &gradient);
  if (!mask.empty()) gradient.coarse.setTo(cv::Scalar::all(0), mask.edges() == 0);
  const std::vector<LineSegment> segments =
      lsd_ ? lsd_->detect(image, mask) : size->edge_chains.detect(gradient, mask);
  const std::vector<Descriptor> descriptors = describeLines(gradient, segments, size->pixel_size);
  std::vector<LineFeature> lines;
  lines.reserve(segments.size());
  for (std::size_t i = 0; i < segments.size(); ++i) lines.push_back({segments[i], descriptors[i]});
  return lines;
}

}  // namespace point_line_odometry
