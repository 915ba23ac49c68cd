#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <vector>

#include "point_line_odometry/types.h"

namespace point_line_odometry {

/// 256-bit binary descriptor of a keypoint (rotated BRIEF) or a line (LBD).
using Descriptor = std::array<std::uint64_t, 4>;

/// An oriented corner with a rotated BRIEF descriptor (ORB, Rublee et al. 2011).
struct Keypoint {
  Eigen::Vector2f pixel = Eigen::Vector2f::Zero();  ///< in the full-resolution image [px]
  float angle_rad = 0.0F;                           ///< orientation by the intensity centroid
  float response = 0.0F;  ///< corner score, comparable within an image and octave
  int octave = 0;         ///< pyramid level it was detected in
  Descriptor descriptor{};
};

/// A segment with its line band descriptor (LBD, Zhang and Koch 2013, binarised).
struct LineFeature {
  LineSegment segment;  ///< in the full-resolution image [px]
  Descriptor descriptor{};
  float scale = 1.0F;  ///< pixels of the image per pixel of the size that it was located in
};

/// Descriptors of a point in both images of a stereo frame.
struct StereoDescriptor {
  Descriptor left{};
  Descriptor right{};
};

/// Everything detected in one stereo frame; pixels of the rectified images.
struct DetectedFeatures {
  std::vector<Keypoint> points_left;
  std::vector<Keypoint> points_right;
  std::vector<LineFeature> lines_left;
  std::vector<LineFeature> lines_right;
};

}  // namespace point_line_odometry
