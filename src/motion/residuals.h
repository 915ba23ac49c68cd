#pragma once

#include <Eigen/Core>

#include "point_line_odometry/motion.h"
#include "point_line_odometry/pluecker.h"
#include "point_line_odometry/stereo_camera.h"

namespace point_line_odometry {

/// Which images of frame k give residuals.
enum class ResidualImages { kLeft, kBoth };

// The residuals below exist once, here; the solver's cost, the weights, the outlier test and the
// covariance use them. Derivatives are made when they are asked for, and only of valid residuals.
// Those by the motion are by (rotation about the axes of the current camera, translation):
// T -> (exp(rotation) R, t + translation).

/// Reprojection error of a point (paper, eq. 5) [px]: observed minus projected u, v in the left
/// and, with kBoth, u in the right image (its v repeats the left one in a rectified pair).
template <ResidualImages kImages>
struct PointResidual {
  using Correspondence = PointCorrespondence;
  static constexpr int kRows = kImages == ResidualImages::kBoth ? 3 : 2;
  using ByMotion = Eigen::Matrix<double, kRows, 6>;
  using ByLandmark = Eigen::Matrix<double, kRows, 3>;

  Eigen::Matrix<double, kRows, 1> value;
  bool valid = false;  ///< false if the point is not in front of the camera

  /// A far point's residual does not change with the translation.
  PointResidual(const PointCorrespondence& point, const StereoCamera& camera,
                const Eigen::Isometry3d& T_curr_prev);

  ByMotion byMotion() const;
  /// By p_prev.
  ByLandmark byLandmark() const { return by_p_ * R_; }

 private:
  Eigen::Matrix<double, kRows, 3> by_p_;  // by the point in the current camera
  Eigen::Matrix3d R_;
  Eigen::Vector3d rotated_;
  bool far_;
};

/// Distances of the observed end points to the projected line (paper, eq. 4 and 6) [px]: start and
/// end in the left and, with kBoth, start and end in the right image.
template <ResidualImages kImages>
struct LineResidual {
  using Correspondence = LineCorrespondence;
  static constexpr int kRows = kImages == ResidualImages::kBoth ? 4 : 2;
  using ByMotion = Eigen::Matrix<double, kRows, 6>;
  using ByLandmark = Eigen::Matrix<double, kRows, 6>;

  Eigen::Matrix<double, kRows, 1> value;
  /// False if the line has no direction in the image, or is not in front of the camera.
  bool valid = false;

  LineResidual(const LineCorrespondence& line, const StereoCamera& camera,
               const Eigen::Isometry3d& T_curr_prev);

  ByMotion byMotion() const;
  /// By (start_prev, end_prev).
  ByLandmark byLandmark() const;

 private:
  Eigen::Matrix<double, 3, kRows> by_moment_;  // by n + t x v, one column for each row
  Eigen::Matrix<double, 3, kRows> by_moment_cross_t_;
  Eigen::Matrix3d R_;
  PlueckerLine rotated_;
  Eigen::Vector3d start_prev_;
  Eigen::Vector3d end_prev_;
};

}  // namespace point_line_odometry
