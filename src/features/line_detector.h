#pragma once

#include <memory>
#include <vector>

#include "features/feature_mask.h"
#include "features/gradient.h"
#include "point_line_odometry/parameters.h"
#include "point_line_odometry/types.h"

namespace point_line_odometry {

/// Finds straight edges to sub-pixel accuracy and validates them a contrario, as LSD does (von Gioi
/// et al. 2010), but grows chains of pixels along the ridges of the gradient instead of regions (as
/// in Edge Drawing, Topal and Akinlar 2012, and ELSED, Suarez et al. 2022), which touches far fewer
/// pixels. Chains jump gaps of up to a fifth of their length and 7 px; segments next to a stronger
/// edge of their polarity are dropped.
class LineDetector {
 public:
  /// \param pixel_size of the gradient's pixels in pixels of the image: segments are validated as
  /// if the image itself had them.
  explicit LineDetector(const LineParameters& parameters, int pixel_size = 1);
  LineDetector(LineDetector&&) noexcept;
  LineDetector& operator=(LineDetector&&) noexcept;
  ~LineDetector();

  /// Segments, the longest first, at most max_count of them; none in an image smaller than 3 x 3.
  /// Edges end where masked pixels begin; a segment that jumps some of them is cut.
  std::vector<LineSegment> detect(const GradientImage& gradient, const FeatureMask& mask = {});

 private:
  struct Scratch;

  void addSegments(const GradientImage& gradient, std::vector<LineSegment>* segments) const;

  LineParameters parameters_;
  int pixel_size_;
  std::unique_ptr<Scratch> scratch_;
};

}  // namespace point_line_odometry
