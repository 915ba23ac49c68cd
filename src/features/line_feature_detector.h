#pragma once

#include <opencv2/core/mat.hpp>
#include <optional>
#include <vector>

#include "features/feature_mask.h"
#include "features/features.h"
#include "features/gradient.h"
#include "features/line_detector.h"
#include "features/lsd_detector.h"
#include "point_line_odometry/parameters.h"

namespace point_line_odometry {

/// Detects and describes the line segments of an image. With lines/coarse_to_fine, edge chains are
/// found in the image at half its size, whose pixels are a quarter and have half of the noise; then
/// each segment is aligned with the edge in the image itself (alignEdge()). One whose edge is too
/// weak there stays where it was found, with a scale of 2.
class LineFeatureDetector {
 public:
  /// Throws std::runtime_error if the detector is OpenCV's LSD, and OpenCV has none.
  LineFeatureDetector(const LineParameters& parameters, LineDetectorKind kind);

  /// The longest first, at most max_count of them. \param image CV_8UC1. \param mask edges end
  /// where masked pixels begin.
  std::vector<LineFeature> detect(const cv::Mat& image, const FeatureMask& mask = {});

 private:
  std::vector<LineFeature> detectAtOneSize(const cv::Mat& image, const FeatureMask& mask);

  LineParameters parameters_;
  LineDetectorKind kind_;
  bool coarse_to_fine_;  // not OpenCV's LSD
  LineDetector edge_chains_;
  std::optional<LsdDetector> lsd_;  // instead of edge_chains_

  // Scratch memory, reused for each image.
  cv::Mat half_;
  GradientImage gradient_;
};

}  // namespace point_line_odometry
