#include "features/stereo_feature_detector.h"

#include <cmath>

namespace point_line_odometry {
namespace {

/// Of the levels at most three times as small as the image, the coarsest: there a segment is still
/// long. 0: there is none.
int octaveOfCoarserLines(const PointParameters& points) {
  constexpr double kMaxScale = 3.0;
  int octave = 0;
  while (octave + 1 < points.levels && std::pow(points.scale_factor, octave + 1) <= kMaxScale)
    ++octave;
  return octave;
}

/// The noise of a level's pixels, and so the least gradient, falls with its scale.
LineFeatureDetector coarserLineDetector(int octave, const PointParameters& points,
                                        LineParameters lines, LineDetectorKind kind) {
  lines.min_gradient /= std::pow(points.scale_factor, octave);
  return LineFeatureDetector(lines, kind);
}

}  // namespace

StereoFeatureDetector::StereoFeatureDetector(const PointParameters& points,
                                             const LineParameters& lines)
    : points_enabled_(points.enabled),
      line_detector_kind_(lineDetectorKind(lines)),
      point_detectors_{PointDetector(points), PointDetector(points)},
      line_detectors_{LineFeatureDetector(lines, line_detector_kind_),
                      LineFeatureDetector(lines, line_detector_kind_)},
      octave_of_coarser_lines_(octaveOfCoarserLines(points)),
      coarser_line_detectors_{
          coarserLineDetector(octave_of_coarser_lines_, points, lines, line_detector_kind_),
          coarserLineDetector(octave_of_coarser_lines_, points, lines, line_detector_kind_)} {}

DetectedFeatures StereoFeatureDetector::detect(const StereoImages& images,
                                               LineResolution resolution, ThreadPool* threads,
                                               const StereoMasks& masks) {
  DetectedFeatures features;
  const std::array<const cv::Mat*, 2> pixels{&images.left, &images.right};
  const std::array<const FeatureMask*, 2> mask{&masks.left, &masks.right};
  const std::array<std::vector<LineFeature>*, 2> lines{&features.lines_left, &features.lines_right};
  const std::array<std::vector<Keypoint>*, 2> points{&features.points_left, &features.points_right};
  // Lines first: they take longer.
  threads->run(4, [&](int task) {
    const auto side = static_cast<std::size_t>(task % 2);
    if (task < 2)
      *lines[side] = line_detectors_[side].detect(*pixels[side], resolution, *mask[side]);
    if (task >= 2 && points_enabled_)
      *points[side] = point_detectors_[side].detectFinest(*pixels[side], *mask[side]);
  });
  return features;
}

std::vector<Keypoint> StereoFeatureDetector::detectCoarserPoints(
    const ImagePyramid& image, ThreadPool* threads, const FeatureMask& mask,
    const PointDetector::IsWanted& is_wanted) {
  if (!points_enabled_) return {};
  return point_detectors_[0].detectCoarser(image, threads, mask, is_wanted);
}

DetectedFeatures StereoFeatureDetector::detectCoarserLines(const ImagePyramid& left,
                                                           const ImagePyramid& right,
                                                           ThreadPool* threads,
                                                           const StereoMasks& masks) {
  DetectedFeatures features;
  const auto level = static_cast<std::size_t>(octave_of_coarser_lines_);
  if (line_detector_kind_ == LineDetectorKind::kNone || level == 0 || level >= left.levels.size())
    return features;
  threads->run(2, [&](int task) {
    const bool is_left = task == 0;
    (is_left ? features.lines_left : features.lines_right) =
        detectCoarserLines(is_left ? left : right, is_left ? masks.left : masks.right,
                           &coarser_line_detectors_[is_left ? 0 : 1]);
  });
  return features;
}

std::vector<LineFeature> StereoFeatureDetector::detectCoarserLines(
    const ImagePyramid& image, const FeatureMask& mask, LineFeatureDetector* detector) const {
  const int octave = octave_of_coarser_lines_;
  std::vector<LineFeature> lines = detector->detect(image.levels[static_cast<std::size_t>(octave)],
                                                    LineResolution::kFull, mask.ofLevel(octave));
  for (LineFeature& line : lines) {
    line.segment.start = image.fromLevel(line.segment.start, octave);
    line.segment.end = image.fromLevel(line.segment.end, octave);
    line.scale = image.ratio(octave).maxCoeff();
  }
  return lines;
}

}  // namespace point_line_odometry
