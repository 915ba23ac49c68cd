#pragma once

#include <Eigen/Core>
#include <vector>

#include "point_line_odometry/types.h"

namespace point_line_odometry {

/// An oriented FAST corner with a rotated BRIEF descriptor (ORB, Rublee et al. 2011).
struct PointFeature {
  Eigen::Vector2f pixel = Eigen::Vector2f::Zero();  ///< in the full-resolution image [px]
  float angle_rad = 0.0F;                           ///< orientation by the intensity centroid
  float response = 0.0F;                            ///< corner score
  int octave = 0;                                   ///< pyramid level it was found in
  Descriptor descriptor{};
};

/// A straight edge. It is directed: walking from start to end, the brighter side is on the right
/// hand in the image (x right, y down), so that the same edge has the same direction in every
/// image.
struct LineSegment {
  Eigen::Vector2f start = Eigen::Vector2f::Zero();  ///< [px]
  Eigen::Vector2f end = Eigen::Vector2f::Zero();    ///< [px]

  Eigen::Vector2f direction() const { return (end - start).normalized(); }
  Eigen::Vector2f middle() const { return 0.5F * (start + end); }
  float length() const { return (end - start).norm(); }
};

/// A segment with its line band descriptor (LBD, Zhang and Koch 2013, binarised).
struct LineFeature {
  LineSegment segment;
  Descriptor descriptor{};
};

/// What finds the segments of a frame, see lines/detector.
enum class LineDetectorKind { kNone, kEdgeChains, kLsd };

/// Lower-case name, as the parameter has it.
const char* toString(LineDetectorKind kind);

/// Everything detected in one stereo frame; pixels of the rectified images.
struct DetectedFeatures {
  std::vector<PointFeature> points_left;
  std::vector<PointFeature> points_right;
  std::vector<LineFeature> lines_left;
  std::vector<LineFeature> lines_right;
};

}  // namespace point_line_odometry
