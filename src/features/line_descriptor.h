#pragma once

#include <vector>

#include "features/features.h"
#include "features/gradient.h"

namespace point_line_odometry {

/// Line band descriptors (LBD, Zhang and Koch 2013): nine bands of seven pixels along each segment,
/// binarised by comparing the statistics of 32 pairs of bands. \param pixel_size of the gradient's
/// pixels in pixels of the image: bands are narrower, rounded up, four pixels at half size (2).
std::vector<Descriptor> describeLines(const GradientImage& gradient,
                                      const std::vector<LineSegment>& segments, int pixel_size = 1);

}  // namespace point_line_odometry
