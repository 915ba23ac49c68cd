#include "features/stereo_feature_detector.h"

#include "features/line_descriptor.h"

namespace point_line_odometry {

StereoFeatureDetector::StereoFeatureDetector(const PointParameters& points,
                                             const LineParameters& lines)
    : points_enabled_(points.enabled),
      line_detector_(lineDetectorKind(lines)),
      point_detectors_{PointDetector(points), PointDetector(points)},
      line_stages_{makeLineStage(lines), makeLineStage(lines)} {}

StereoFeatureDetector::LineStage StereoFeatureDetector::makeLineStage(
    const LineParameters& lines) const {
  LineStage stage{{}, LineDetector(lines), std::nullopt};
  if (line_detector_ == LineDetectorKind::kLsd) stage.lsd.emplace(lines);
  return stage;
}

std::vector<LineFeature> StereoFeatureDetector::LineStage::detect(const cv::Mat& image,
                                                                  const FeatureMask& mask) {
  computeGradient(image, &gradient);
  if (!mask.empty()) gradient.coarse.setTo(cv::Scalar::all(0), mask.edges() == 0);
  const std::vector<LineSegment> segments =
      lsd ? lsd->detect(image, mask) : edge_chains.detect(gradient, mask);
  const std::vector<Descriptor> descriptors = describeLines(gradient, segments);
  std::vector<LineFeature> features;
  features.reserve(segments.size());
  for (std::size_t i = 0; i < segments.size(); ++i)
    features.push_back({segments[i], descriptors[i]});
  return features;
}

DetectedFeatures StereoFeatureDetector::detect(const StereoImages& images, ThreadPool* threads,
                                               const StereoMasks& masks) {
  DetectedFeatures features;
  // Lines first: they take longer.
  threads->run(4, [&](int task) {
    const bool left = task % 2 == 0;
    const cv::Mat& image = left ? images.left : images.right;
    const FeatureMask& mask = left ? masks.left : masks.right;
    if (task < 2 && line_detector_ != LineDetectorKind::kNone) {
      (left ? features.lines_left : features.lines_right) =
          line_stages_[left ? 0 : 1].detect(image, mask);
    }
    if (task >= 2 && points_enabled_) {
      (left ? features.points_left : features.points_right) =
          point_detectors_[left ? 0 : 1].detectFinest(image, mask);
    }
  });
  return features;
}

std::vector<Keypoint> StereoFeatureDetector::detectCoarserPoints(const ImagePyramid& image,
                                                                 ThreadPool* threads,
                                                                 const FeatureMask& mask) {
  if (!points_enabled_) return {};
  return point_detectors_[0].detectCoarser(image, threads, mask);
}

}  // namespace point_line_odometry
