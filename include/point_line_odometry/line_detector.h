#pragma once

#include <cstdint>
#include <memory>
#include <opencv2/core.hpp>
#include <vector>

#include "point_line_odometry/features.h"
#include "point_line_odometry/parameters.h"

namespace point_line_odometry {

/// Gradient of a smoothed image by the 3 x 3 Sobel operator; 8 units are one grey level per pixel.
/// Lines are detected and described from it.
struct GradientImage {
  cv::Mat gx;         ///< CV_16SC1
  cv::Mat gy;         ///< CV_16SC1
  cv::Mat magnitude;  ///< CV_16UC1, |gx| + |gy|
  cv::Mat smooth;     ///< CV_8UC1, the image after a 5 x 5 Gaussian (sigma 1 px)
  cv::Mat coarse;     ///< CV_8SC2, (gx, gy) / 4, saturated: a quarter of the memory
};

/// Smooths a CV_8UC1 image and differentiates it. The memory of `gradient` is used again if it has
/// the image's size.
void computeGradient(const cv::Mat& image, GradientImage* gradient);

/// Fewest aligned pixels that make a segment of n pixels meaningful: its number of false alarms is
/// at most 1 in the a-contrario model of von Gioi et al. 2010.
class AContrarioTable {
 public:
  AContrarioTable() = default;
  explicit AContrarioTable(cv::Size image_size);

  /// \param n pixels of the segment. \param aligned those whose gradient is within 22.5 deg of the
  /// segment's normal.
  bool meaningful(int n, int aligned) const;

  cv::Size imageSize() const { return image_size_; }

 private:
  cv::Size image_size_;
  std::vector<int> fewest_;
};

/// Finds straight edges to sub-pixel accuracy and validates them a contrario, as LSD does (von Gioi
/// et al. 2010), but grows chains of pixels along the ridges of the gradient instead of regions (as
/// in Edge Drawing, Topal and Akinlar 2012, and ELSED, Suarez et al. 2022), which touches far fewer
/// pixels. Chains jump gaps of up to a fifth of their length and 7 px; segments beside a stronger
/// edge of their kind are dropped.
class LineDetector {
 public:
  explicit LineDetector(const LineParameters& parameters);
  LineDetector(LineDetector&&) noexcept;
  LineDetector& operator=(LineDetector&&) noexcept;
  ~LineDetector();

  /// Segments, the longest first, at most max_count of them; none in an image smaller than 3 x 3.
  std::vector<LineSegment> detect(const GradientImage& gradient);

 private:
  struct Scratch;

  void addSegments(const GradientImage& gradient, std::vector<LineSegment>* segments) const;

  LineParameters parameters_;
  std::unique_ptr<Scratch> scratch_;
};

/// Line band descriptors (LBD, Zhang and Koch 2013): nine bands of seven pixels along each segment,
/// binarised by comparing the statistics of 32 pairs of bands.
std::vector<Descriptor> describeLines(const GradientImage& gradient,
                                      const std::vector<LineSegment>& segments);

}  // namespace point_line_odometry
