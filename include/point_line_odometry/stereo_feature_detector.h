#pragma once

#include <array>
#include <optional>

#include "point_line_odometry/features.h"
#include "point_line_odometry/line_detector.h"
#include "point_line_odometry/lsd_detector.h"
#include "point_line_odometry/parameters.h"
#include "point_line_odometry/point_detector.h"
#include "point_line_odometry/thread_pool.h"

namespace point_line_odometry {

/// Detects and describes points and lines in both images of a stereo frame, in parallel.
class StereoFeatureDetector {
 public:
  /// Throws std::runtime_error if lines/detector is lsd and OpenCV has none.
  StereoFeatureDetector(const PointParameters& points, const LineParameters& lines);

  /// What finds the segments: what lines/detector asks for, or what stands in its place.
  LineDetectorKind lineDetector() const { return line_detector_; }

  /// The same result whatever the number of threads. Images must be CV_8UC1.
  DetectedFeatures detect(const StereoImages& images, ThreadPool* threads);

  /// Points of the coarser levels of the pyramid, which detect() leaves out: noise is averaged out
  /// there, and soft spots are corners.
  DetectedFeatures detectCoarserPoints(const ImagePyramid& left, const ImagePyramid& right,
                                       ThreadPool* threads);

 private:
  /// What finds the lines of one image, with its scratch memory.
  struct LineStage {
    GradientImage gradient;
    LineDetector edge_chains;
    std::optional<LsdDetector> lsd;  // instead of edge_chains

    std::vector<LineFeature> detect(const cv::Mat& image);
  };

  LineStage makeLineStage(const LineParameters& lines) const;

  bool points_enabled_;
  LineDetectorKind line_detector_;
  std::array<PointDetector, 2> point_detectors_;  // left, right
  std::array<LineStage, 2> line_stages_;
};

}  // namespace point_line_odometry
