#pragma once

#include <Eigen/Core>

#include "geometry/pluecker.h"
#include "motion/correspondence.h"
#include "point_line_odometry/stereo_camera.h"

namespace point_line_odometry {

/// Which images of frame k give residuals.
enum class ResidualImages { kLeft, kBoth };

// The cost function, the square-root information, the outlier test and the covariance all use the
// residuals below. Jacobians are computed on demand, and of valid residuals only. Those by the
// motion are by (rotation about the axes of the current camera, translation): T -> (exp(rotation)
// R, t + translation).

/// Reprojection error of a point (paper, eq. 5) [px]: observed minus projected u, v in the left
/// and, with kBoth, u in the right image (its v repeats the left one in a rectified pair).
template <ResidualImages kImages>
struct PointResidual {
  using Correspondence = PointCorrespondence;
  static constexpr ResidualImages kResidualImages = kImages;
  static constexpr int kRows = kImages == ResidualImages::kBoth ? 3 : 2;
  using Value = Eigen::Matrix<double, kRows, 1>;
  using JacobianByMotion = Eigen::Matrix<double, kRows, 6>;
  using JacobianByLandmark = Eigen::Matrix<double, kRows, 3>;
  using Covariance = Eigen::Matrix<double, kRows, kRows>;

  Value value;         ///< with the match's offset
  bool valid = false;  ///< false if the point is not in front of the camera

  /// The residual of a far point has a zero Jacobian by the translation.
  PointResidual(const PointCorrespondence& point, const StereoCamera& camera,
                const Eigen::Isometry3d& T_curr_prev);

  JacobianByMotion jacobianByMotion() const;
  /// By the translation; of a far point, too.
  const JacobianByLandmark& jacobianByTranslation() const { return J_p_; }
  /// By p_prev.
  JacobianByLandmark jacobianByLandmark() const { return J_p_ * R_; }

 private:
  Eigen::Matrix<double, kRows, 3> J_p_;  // Jacobian by the point in the current camera
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
  using Value = Eigen::Matrix<double, kRows, 1>;
  using JacobianByMotion = Eigen::Matrix<double, kRows, 6>;
  using JacobianByLandmark = Eigen::Matrix<double, kRows, 6>;
  using Covariance = Eigen::Matrix<double, kRows, kRows>;

  Value value;
  /// False if the line has no direction in the image, or is not in front of the camera.
  bool valid = false;

  LineResidual(const LineCorrespondence& line, const StereoCamera& camera,
               const Eigen::Isometry3d& T_curr_prev);

  JacobianByMotion jacobianByMotion() const;
  /// By (start_prev, end_prev).
  JacobianByLandmark jacobianByLandmark() const;
  /// Each row by the column of its end point.
  const Value& derivativeByColumn() const { return by_column_; }

 private:
  Value by_column_;
  Eigen::Matrix<double, 3, kRows> J_moment_;  // gradients by n + t x v, one column for each row
  Eigen::Matrix<double, 3, kRows> J_moment_cross_t_;
  Eigen::Matrix3d R_;
  PlueckerLine rotated_;
  Eigen::Vector3d start_prev_;
  Eigen::Vector3d end_prev_;
};

/// Covariance of a residual [px^2]: the noise of its pixels, and that of the landmark.
template <typename Residual>
typename Residual::Covariance residualCovariance(const Residual& residual,
                                                 const typename Residual::Correspondence& match) {
  const typename Residual::JacobianByLandmark J = residual.jacobianByLandmark();
  return J * match.covariance * J.transpose() +
         match.sigma_px * match.sigma_px * Residual::Covariance::Identity();
}

}  // namespace point_line_odometry
