#pragma once

#include <functional>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "features/feature_mask.h"
#include "point_line_odometry/parameters.h"
#include "point_line_odometry/types.h"

namespace point_line_odometry {

/// OpenCV's line segment detector (LSD with its standard refinement, von Gioi et al. 2010), that of
/// the paper. OpenCV 4.1.0 to 4.5.3 have the class, but no detector in it.
class LsdDetector {
 public:
  /// Whether this OpenCV has it, by running it on a small image.
  static bool isAvailable();

  /// Throws std::runtime_error if this OpenCV does not have it.
  explicit LsdDetector(const LineParameters& parameters);

  /// Segments of a CV_8UC1 image of at least min_length_px, the longest first, at most max_count of
  /// them. Those that touch masked pixels are cut there.
  std::vector<LineSegment> detect(const cv::Mat& image, const FeatureMask& mask = {}) const;

 private:
  LineParameters parameters_;
  cv::Ptr<cv::LineSegmentDetector> lsd_;
};

/// The detector that lines/detector selects. \param lsd_is_available is called where it matters.
LineDetectorKind lineDetectorKind(
    const LineParameters& parameters,
    const std::function<bool()>& lsd_is_available = LsdDetector::isAvailable);

}  // namespace point_line_odometry
