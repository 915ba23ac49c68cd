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

/// At which size of the image line segments are looked for.
enum class LineResolution {
  kFull,
  kCoarseToFine,  ///< half the size, then aligned at full size; edge chains only
};

/// Coarse to fine where points are many and so determine the motion (lines/coarse_to_fine_points).
/// \param num_points stereo points of the frame that this one is matched with; 0 without one.
LineResolution lineResolutionAfter(std::size_t num_points, const LineParameters& parameters);

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
  std::vector<LineFeature> detect(const cv::Mat& image, LineResolution resolution,
                                  const FeatureMask& mask = {});

 private:
  /// What depends on the size of the image.
  struct Size {
    int pixel_size;  ///< in pixels of the image
    LineDetector edge_chains;
    GradientImage gradient;  ///< scratch memory, reused for each image
  };

  std::vector<LineFeature> detectAt(Size* size, const cv::Mat& image, const FeatureMask& mask);

  LineParameters parameters_;
  LineDetectorKind kind_;
  Size full_;
  Size half_;
  cv::Mat half_image_;              // scratch memory
  std::optional<LsdDetector> lsd_;  // instead of edge chains
};

}  // namespace point_line_odometry
