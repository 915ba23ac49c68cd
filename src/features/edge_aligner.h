#pragma once

#include <opencv2/core/mat.hpp>
#include <optional>

#include "features/feature_mask.h"
#include "point_line_odometry/parameters.h"
#include "point_line_odometry/types.h"

namespace point_line_odometry {

/// Aligns a predicted segment with the edge that the image has there: across it, in every other
/// column (of a steep segment: row), the strongest gradient of the segment's polarity within 3 px
/// is located to a sub-pixel, and a straight line is fitted to these (moving edges, Bouthemy 1989).
/// Nothing unless most of the segment lies in the image, not masked, and on one straight edge.
/// \param image CV_8UC1. \return the predicted ends, projected on the edge.
std::optional<LineSegment> alignEdge(const cv::Mat& image, const FeatureMask& mask,
                                     const LineSegment& predicted,
                                     const LineParameters& parameters);

}  // namespace point_line_odometry
