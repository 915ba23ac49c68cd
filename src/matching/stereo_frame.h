#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <vector>

#include "features/features.h"
#include "features/image_pyramid.h"
#include "geometry/rolling_shutter.h"
#include "geometry/triangulation.h"
#include "point_line_odometry/stereo_correction.h"
#include "point_line_odometry/types.h"

namespace point_line_odometry {

/// Pixel axes: Jacobian of a surface point by the pixel (u, v) that observes it, in the frame of a
/// camera or of the map [m / px].
using PixelAxes = Eigen::Matrix<double, 3, 2>;

/// A point matched in both images of one stereo frame.
struct StereoPoint {
  int left = -1;   ///< index into DetectedFeatures::points_left
  int right = -1;  ///< index into DetectedFeatures::points_right
  Eigen::Vector2f right_px =
      Eigen::Vector2f::Zero();  ///< sub-pixel position in the right image, uncorrected
  double sigma_px = 1.0;        ///< of each pixel coordinate
  /// Of its surface: derivative of the right column minus the left one by the left pixel.
  Eigen::Vector2f slope = Eigen::Vector2f::Zero();
  TriangulatedPoint triangulated;
  bool far = false;  ///< too far for a depth: it constrains the rotation only
};

/// A segment matched in both images of one stereo frame. Those nearly parallel to the epipolar
/// lines cannot be triangulated.
struct StereoLine {
  int left = -1;   ///< index into DetectedFeatures::lines_left
  int right = -1;  ///< index into DetectedFeatures::lines_right
  std::optional<TriangulatedLine> triangulated;
};

/// One stereo frame after detection, stereo matching and triangulation; the next frame is matched
/// with it.
struct StereoFrame {
  std::int64_t stamp_ns = 0;
  ImagePyramid left_image;  ///< a copy: the next frames align its patches
  DetectedFeatures features;
  StereoCorrection correction;  ///< with which points and lines are located
  RollingShutter shutter;       ///< the same, at the stamp
  std::vector<StereoPoint> points;
  std::vector<StereoLine> lines;
  /// Points that are not tracked, as features rest there while the scene moves.
  std::vector<StereoPoint> resting_points;
};

}  // namespace point_line_odometry
