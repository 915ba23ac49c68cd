#include "point_line_odometry/stereo_feature_detector.h"

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

std::vector<LineFeature> StereoFeatureDetector::LineStage::detect(const cv::Mat& image) {
  computeGradient(image, &gradient);
  const std::vector<LineSegment> segments = lsd ? lsd->detect(image) : edge_chains.detect(gradient);
  const std::vector<Descriptor> descriptors = describeLines(gradient, segments);
  std::vector<LineFeature> features;
  features.reserve(segments.size());
  for (std::size_t i = 0; i < segments.size(); ++i)
    features.push_back({segments[i], descriptors[i]});
  return features;
}

DetectedFeatures StereoFeatureDetector::detect(const StereoImages& images, ThreadPool* threads) {
  DetectedFeatures features;
  // Lines first: they take longer.
  threads->run(4, [&](int task) {
    const bool left = task % 2 == 0;
    const cv::Mat& image = left ? images.left : images.right;
    if (task < 2 && line_detector_ != LineDetectorKind::kNone) {
      (left ? features.lines_left : features.lines_right) =
          line_stages_[left ? 0 : 1].detect(image);
    }
    if (task >= 2 && points_enabled_) {
      (left ? features.points_left : features.points_right) =
          point_detectors_[left ? 0 : 1].detectFinest(image);
    }
  });
  return features;
}

DetectedFeatures StereoFeatureDetector::detectCoarserPoints(const ImagePyramid& left,
                                                            const ImagePyramid& right,
                                                            ThreadPool* threads) {
  DetectedFeatures features;
  if (!points_enabled_) return features;
  threads->run(2, [&](int task) {
    if (task == 0) {
      features.points_left = point_detectors_[0].detectCoarser(left);
    } else {
      features.points_right = point_detectors_[1].detectCoarser(right);
    }
  });
  return features;
}

}  // namespace point_line_odometry
