#pragma once

#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

#include "point_line_odometry/features.h"
#include "point_line_odometry/parameters.h"

namespace point_line_odometry {

/// Gradient of a smoothed image by the 3 x 3 Sobel operator; 8 units are one grey level per pixel. Lines are detected and
/// described from it.
struct GradientImage {
  cv::Mat gx;         ///< CV_16SC1
  cv::Mat gy;         ///< CV_16SC1
  cv::Mat magnitude;  ///< CV_16UC1, |gx| + |gy|
};

/// Gradient of a CV_8UC1 image after a 5 x 5 Gaussian (sigma 1 px).
GradientImage computeGradient(const cv::Mat& image);

/// Finds straight edges to sub-pixel accuracy and validates them a contrario, as LSD does (von Gioi et al. 2010), but
/// grows chains of pixels along the ridges of the gradient instead of regions (as in Edge Drawing, Topal and Akinlar
/// 2012, and ELSED, Suarez et al. 2022), which touches far fewer pixels.
class LineDetector {
 public:
  explicit LineDetector(const LineParameters& parameters) : parameters_(parameters) {}

  /// Segments, the longest first, at most max_count of them. The image must be at least 3 x 3.
  std::vector<LineSegment> detect(const GradientImage& gradient);

 private:
  struct ChainPixel {
    int x;
    int y;
  };

  void findAnchors(const GradientImage& gradient, int threshold);
  std::vector<LineSegment> cutIntoSegments() const;

  LineParameters parameters_;
  cv::Mat visited_;                    // CV_8UC1
  std::vector<ChainPixel> anchors_;    // the strongest first
  std::vector<ChainPixel> chain_;
};

/// Line band descriptors (LBD, Zhang and Koch 2013): nine bands of seven pixels along each segment, binarised by comparing
/// the statistics of 32 pairs of bands.
std::vector<Descriptor> describeLines(const GradientImage& gradient, const std::vector<LineSegment>& segments);

}  // namespace point_line_odometry
