#pragma once

#include <Eigen/Core>
#include <optional>

#include "point_line_odometry/features.h"
#include "point_line_odometry/stereo_camera.h"
#include "point_line_odometry/types.h"

namespace point_line_odometry {

/// A point in the left camera's frame with its covariance.
struct TriangulatedPoint {
  Eigen::Vector3d p_camera = Eigen::Vector3d::Zero();    ///< [m]
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();  ///< [m^2]
};

/// The end points of the left segment in the left camera's frame, with their joint covariance.
/// Noise along the line is not in it: it does not move the line.
struct TriangulatedLine {
  Eigen::Vector3d start_camera = Eigen::Vector3d::Zero();  ///< [m]
  Eigen::Vector3d end_camera = Eigen::Vector3d::Zero();    ///< [m]
  Matrix6d covariance = Matrix6d::Zero();                  ///< of (start, end) [m^2]
};

/// Noise-free inverse of the stereo projection. \param disparity_px must be positive.
Eigen::Vector3d backProject(const StereoCamera& camera, const Eigen::Vector2d& left_px,
                            double disparity_px);

/// Nothing if the disparity is below the smallest one.
/// \param sigma_px noise of the left pixel's coordinates; the disparity's is sqrt(2) of it.
std::optional<TriangulatedPoint> triangulatePoint(const StereoCamera& camera,
                                                  const Eigen::Vector2d& left_px, double right_u_px,
                                                  double sigma_px, double min_disparity_px);

/// A point that is too far for its disparity to tell a distance: what is measured, small or by the
/// noise or a calibration's error negative, is drawn towards 0, where it is more likely to be the
/// less it differs from it, and what that changes it by is added to its noise. Such a point tells
/// rotations only: many of them would agree on a translation that their common bias makes up.
TriangulatedPoint triangulateFarPoint(const StereoCamera& camera, const Eigen::Vector2d& left_px,
                                      double right_u_px, double sigma_px);

/// What limits the triangulation of lines.
struct LineTriangulationLimits {
  double min_angle_rad = 0.26;      ///< smallest angle to the epipolar direction, in both images
  double min_disparity_px = 1.0;    ///< at both end points
  double max_disparity_px = 200.0;  ///< at both end points
  double max_extrapolation = 0.5;   ///< how far the right segment is extended to the rows of the
                                    ///< left one, in its own length
};

/// Cuts the rows of the left segment's end points with the right segment. Nothing if the pair is
/// too near to the epipolar direction, hardly shares rows, or its disparity is out of bounds: then
/// the stereo geometry does not say where it is. \param sigma_px noise of end points across the
/// segments.
std::optional<TriangulatedLine> triangulateLine(const StereoCamera& camera, const LineSegment& left,
                                                const LineSegment& right, double sigma_px,
                                                const LineTriangulationLimits& limits);

}  // namespace point_line_odometry
