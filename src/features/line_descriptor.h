#pragma once

#include <vector>

#include "features/features.h"
#include "features/gradient.h"

namespace point_line_odometry {

/// Line band descriptors (LBD, Zhang and Koch 2013): nine bands of seven pixels along each segment,
/// binarised by comparing the statistics of 32 pairs of bands. \param pixel_size of a pixel of the
/// gradient, at least 1: in an image at half its size (2) the bands have four.
std::vector<Descriptor> describeLines(const GradientImage& gradient,
                                      const std::vector<LineSegment>& segments, int pixel_size = 1);

}  // namespace point_line_odometry
