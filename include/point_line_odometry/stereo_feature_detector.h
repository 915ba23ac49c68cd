#pragma once

#include <array>

#include "point_line_odometry/features.h"
#include "point_line_odometry/line_detector.h"
#include "point_line_odometry/parameters.h"
#include "point_line_odometry/point_detector.h"

namespace point_line_odometry {

/// Detects and describes points and lines in both images of a stereo frame, left and right in
/// parallel.
class StereoFeatureDetector {
 public:
  StereoFeatureDetector(const PointParameters& points, const LineParameters& lines);

  /// The same result whatever the number of threads. Images must be CV_8UC1.
  DetectedFeatures detect(const StereoImages& images);

 private:
  struct MonoFeatures {
    std::vector<PointFeature> points;
    std::vector<LineFeature> lines;
  };

  MonoFeatures detectMono(const cv::Mat& image, LineDetector* line_detector) const;

  bool points_enabled_;
  bool lines_enabled_;
  PointDetector point_detector_;
  std::array<LineDetector, 2> line_detectors_;  // one an image: they keep scratch memory
};

}  // namespace point_line_odometry
