#pragma once

#include <cstddef>
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

/// Where line segments are looked for.
enum class LineSearch {
  kFullSize,      ///< in the image
  kCoarseToFine,  ///< in the image at half its size; edge chains only
};

/// How the lines of a frame are looked for: coarse to fine where points are many and so determine
/// the motion. \param num_points located in the previous frame; 0 without one.
LineSearch lineSearchAfter(std::size_t num_points, const LineParameters& parameters);

/// Detects and describes the line segments of an image. Coarse to fine, edge chains are found in
/// the image at half its size, whose pixels are a quarter and have half of the noise; then each
/// segment is aligned with the edge in the image itself (alignEdge()). One whose edge is too weak
/// there stays where it was found, with a scale of 2.
class LineFeatureDetector {
 public:
  /// Throws std::runtime_error if the detector is OpenCV's LSD, and OpenCV has none.
  LineFeatureDetector(const LineParameters& parameters, LineDetectorKind kind);

  /// The longest first, at most max_count of them. \param image CV_8UC1. \param mask edges end
  /// where masked pixels begin.
  std::vector<LineFeature> detect(const cv::Mat& image, const FeatureMask& mask = {},
                                  LineSearch search = LineSearch::kFullSize);

 private:
  std::vector<LineFeature> detectAtOneSize(const cv::Mat& image, const FeatureMask& mask,
                                           int pixel_size);

  LineParameters parameters_;
  LineDetectorKind kind_;
  LineDetector edge_chains_;
  LineDetector edge_chains_at_half_size_;
  std::optional<LsdDetector> lsd_;  // instead of edge chains

  // Scratch memory, reused for each image.
  cv::Mat half_;
  GradientImage gradient_;
};

}  // namespace point_line_odometry
