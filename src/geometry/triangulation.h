#pragma once

#include <Eigen/Core>
#include <optional>

#include "point_line_odometry/stereo_camera.h"
#include "point_line_odometry/types.h"

namespace point_line_odometry {

/// A point in the left camera's frame with its covariance.
struct TriangulatedPoint {
  Eigen::Vector3d p_camera = Eigen::Vector3d::Zero();    ///< [m]
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();  ///< [m^2]
};

/// The end points of the left segment in the left camera's frame, with their joint covariance.
/// Noise along the line is left out: it does not move the line.
struct TriangulatedLine {
  Eigen::Vector3d start_camera = Eigen::Vector3d::Zero();  ///< [m]
  Eigen::Vector3d end_camera = Eigen::Vector3d::Zero();    ///< [m]
  Matrix6d covariance = Matrix6d::Zero();                  ///< of (start, end) [m^2]
};

/// Noise-free inverse of the stereo projection. \param disparity_px must be positive.
Eigen::Vector3d backProject(const StereoCamera& camera, const Eigen::Vector2d& left_px,
                            double disparity_px);

/// Derivative of backProject() by (u, v, disparity) [m/px]. \param p the point [m]. \param
/// disparity_px its disparity.
Eigen::Matrix3d backProjectionJacobian(const StereoCamera& camera, const Eigen::Vector3d& p,
                                       double disparity_px);

/// Nothing if the disparity is below the smallest one.
/// \param sigma_px noise of the left pixel's coordinates; the disparity's is sqrt(2) of it.
std::optional<TriangulatedPoint> triangulatePoint(const StereoCamera& camera,
                                                  const Eigen::Vector2d& left_px, double right_u_px,
                                                  double sigma_px, double min_disparity_px);

/// A point too far for its disparity to give a depth. The measured disparity d, which noise or a
/// calibration error can make negative, is shrunk to d^3 / (d^2 + 2 sigma_px^2), at least 0.01 px,
/// and the difference is added to its noise. Such a point constrains the rotation only: a common
/// bias of many disparities would pass for a translation.
TriangulatedPoint triangulateFarPoint(const StereoCamera& camera, const Eigen::Vector2d& left_px,
                                      double right_u_px, double sigma_px);

/// Limits of the triangulation of lines.
struct LineTriangulationLimits {
  double min_angle_rad = 0.26;      ///< smallest angle to the epipolar direction, in both images
  double min_disparity_px = 1.0;    ///< at both end points
  double max_disparity_px = 200.0;  ///< at both end points
  double max_extrapolation = 0.5;   ///< of the right segment to the rows of the
                                    ///< left one, as a share of its length
};

/// Intersects the rows of the left segment's end points with the right segment. Nothing if the pair
/// is nearly parallel to the epipolar lines, hardly shares rows, or its disparity is out of bounds:
/// then the stereo geometry does not constrain it. \param sigma_px noise of end points along the
/// normals of the segments.
std::optional<TriangulatedLine> triangulateLine(const StereoCamera& camera, const LineSegment& left,
                                                const LineSegment& right, double sigma_px,
                                                const LineTriangulationLimits& limits);

}  // namespace point_line_odometry
