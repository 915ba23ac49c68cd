#include "point_line_odometry/stereo_feature_detector.h"

#include <opencv2/core/utility.hpp>

namespace point_line_odometry {

StereoFeatureDetector::StereoFeatureDetector(const PointParameters& points,
                                             const LineParameters& lines)
    : points_enabled_(points.enabled),
      lines_enabled_(lines.enabled),
      point_detector_(points),
      line_detectors_{LineDetector(lines), LineDetector(lines)} {}

StereoFeatureDetector::MonoFeatures StereoFeatureDetector::detectMono(
    const cv::Mat& image, LineDetector* line_detector) const {
  MonoFeatures features;
  if (points_enabled_) features.points = point_detector_.detect(image);
  if (lines_enabled_) {
    const GradientImage gradient = computeGradient(image);
    const std::vector<LineSegment> segments = line_detector->detect(gradient);
    const std::vector<Descriptor> descriptors = describeLines(gradient, segments);
    features.lines.reserve(segments.size());
    for (std::size_t i = 0; i < segments.size(); ++i)
      features.lines.push_back({segments[i], descriptors[i]});
  }
  return features;
}

DetectedFeatures StereoFeatureDetector::detect(const StereoImages& images) {
  const std::array<const cv::Mat*, 2> mats{&images.left, &images.right};
  std::array<MonoFeatures, 2> features;
  cv::parallel_for_(cv::Range(0, 2), [&](const cv::Range& range) {
    for (int i = range.start; i < range.end; ++i)
      features[i] = detectMono(*mats[i], &line_detectors_[i]);
  });
  return {std::move(features[0].points), std::move(features[1].points),
          std::move(features[0].lines), std::move(features[1].lines)};
}

}  // namespace point_line_odometry
