#pragma once

#include <opencv2/imgproc.hpp>

namespace point_line_odometry {

/// OpenCV's line segment detector with its standard refinement; null if this OpenCV has none, which
/// is found by running it on a small image: OpenCV 4.1.0 to 4.5.3 have the class, but no detector
/// in it.
cv::Ptr<cv::LineSegmentDetector> createLsd();

}  // namespace point_line_odometry
