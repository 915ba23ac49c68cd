#pragma once

#include <Eigen/Core>
#include <vector>

#include "geometry/rolling_shutter.h"
#include "point_line_odometry/stereo_correction.h"
#include "point_line_odometry/types.h"

namespace point_line_odometry {

/// Observation of a point in a stereo frame: the pixels of calibrated cameras with a global
/// shutter, with the stereo correction and the rolling shutter's applied.
struct PointObservation {
  Eigen::Vector2d left_px = Eigen::Vector2d::Zero();
  Eigen::Vector2d right_px = Eigen::Vector2d::Zero();
  double sigma_px = 1.0;  ///< of each pixel coordinate
  double patch_px = 0.0;  ///< side of the patch that was aligned in both images; 0: none
};

/// Observation of a line in a stereo frame: the segments in its two images.
struct LineObservation {
  Eigen::Vector2d left_start_px = Eigen::Vector2d::Zero();
  Eigen::Vector2d left_end_px = Eigen::Vector2d::Zero();
  Eigen::Vector2d right_start_px = Eigen::Vector2d::Zero();
  Eigen::Vector2d right_end_px = Eigen::Vector2d::Zero();
  double sigma_px = 1.0;  ///< of an end point, along the line's normal
};

/// A point with its position in the previous left camera, and its observation in frame k.
struct PointCorrespondence : PointObservation {
  Eigen::Vector3d p_prev = Eigen::Vector3d::Zero();      ///< in the previous left camera [m]
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();  ///< of p_prev [m^2]
  bool far = false;  ///< too far for a depth: it constrains the rotation only
  /// Added to the residual (u, v in the left, u in the right image): what a refined landmark has
  /// taken from it.
  Eigen::Vector3d offset_px = Eigen::Vector3d::Zero();
};

/// A line with its position in the previous left camera, and its observation in frame k.
struct LineCorrespondence : LineObservation {
  Eigen::Vector3d start_prev =
      Eigen::Vector3d::Zero();  ///< end points in the previous left camera [m]
  Eigen::Vector3d end_prev = Eigen::Vector3d::Zero();
  Matrix6d covariance = Matrix6d::Zero();  ///< of (start, end) [m^2]
};

/// True for a match that does not constrain the translation.
inline bool isFar(const PointCorrespondence& point) { return point.far; }
inline bool isFar(const LineCorrespondence&) { return false; }

/// Where a match is in the left image; of a line its middle.
inline Eigen::Vector2d pixelOf(const PointCorrespondence& point) { return point.left_px; }
inline Eigen::Vector2d pixelOf(const LineCorrespondence& line) {
  return 0.5 * (line.left_start_px + line.left_end_px);
}

struct Correspondences {
  std::vector<PointCorrespondence> points;
  std::vector<LineCorrespondence> lines;
  /// Standard deviation of an error that all disparities have in common, as StereoCorrection's.
  double disparity_error_px = StereoCorrection::kCalibratedPx;
  RollingShutter shutter;  ///< of frame k
};

}  // namespace point_line_odometry
