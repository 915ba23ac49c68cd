#pragma once

#include <Eigen/Geometry>
#include <vector>

#include "geometry/rolling_shutter.h"
#include "motion/patch_overlap.h"
#include "point_line_odometry/residual_histogram.h"
#include "point_line_odometry/stereo_camera.h"
#include "point_line_odometry/types.h"

namespace point_line_odometry {

/// Normal equations of the solver's perturbation (rotation, translation).
struct NormalEquations {
  Matrix6d information = Matrix6d::Zero();  ///< J^T J
  /// Derivative of J^T r by the translation at which far points are seen. They do not estimate it:
  /// its error remains in the rotation.
  Matrix6d shift_of_far = Matrix6d::Zero();
  /// Derivative of J^T r by a common error of all disparities [1 / px].
  Vector6d by_disparity = Vector6d::Zero();
  /// Derivative of J^T r by the camera's velocity in a rolling shutter, in the solver's order [s]:
  /// what is exposed later by t has moved on by a motion of t.
  Matrix6d by_velocity = Matrix6d::Zero();
  /// Covariance of J^T r beyond J^T J, as residuals are correlated.
  Matrix6d correlation = Matrix6d::Zero();

  NormalEquations& operator+=(const NormalEquations& other);
  NormalEquations& operator-=(const NormalEquations& other);

  /// Covariance of the perturbation for residuals of variance 1, with `gain` the derivative of the
  /// perturbation by J^T r.
  Matrix6d covariance(Matrix6d* gain) const;
};

/// The patch in the left image by which a point was observed, and the Jacobian of its whitened,
/// weighted residual.
struct PatchJacobian {
  PatchArea area;
  Eigen::Matrix<double, Eigen::Dynamic, 6, 0, 3, 6> J;
};

/// The normal equations, and the contribution of each part of the left image to them.
class ImageInformation {
 public:
  explicit ImageInformation(const StereoCamera& camera) : part_px_(camera.width / kColumns) {}

  /// Adds the information of a match at a pixel of the left image.
  void add(const Eigen::Vector2d& left_px, const NormalEquations& equations);

  /// Adds the correlations of points whose patches overlap: they share the noise of the pixels that
  /// they have in common.
  void addCorrelations(const std::vector<PatchJacobian>& patches);

  /// The sum without the part of the image that has the most influence on the motion (trace of its
  /// hat matrix). A motion that is constrained by one part only has no redundancy: wrong matches
  /// there agree with the wrong motion that they cause.
  NormalEquations withoutMostInfluentialPart() const;

 private:
  static constexpr double kColumns = 8.0;  // parts in a row of the image; they are square

  struct Part {
    Eigen::Vector2i cell;
    NormalEquations equations;
  };

  /// Index of the part at a pixel, which is added if it is new.
  std::size_t partAt(const Eigen::Vector2d& left_px);

  double part_px_;
  NormalEquations whole_;
  std::vector<Part> parts_;
};

/// Sums over the residuals at the estimate, for its covariance. psi is the derivative of the Huber
/// loss. Residuals of far points, whose depths are hardly known, are smaller than their covariances
/// say; the noise of the others does not follow from them.
struct ResidualStatistics {
  /// \param disparity_error that all disparities have in common: its standard deviation [px]. It
  /// does not average out over a frame's points, nor does the error of the velocity in the shutter.
  ResidualStatistics(const StereoCamera& camera, double disparity_error,
                     const RollingShutter& shutter_of_frame)
      : information(camera), disparity_error_px(disparity_error), shutter(shutter_of_frame) {}

  ImageInformation information;
  double disparity_error_px;
  RollingShutter shutter;
  double sum_psi2 = 0.0;            ///< of psi(r)^2
  double sum_weights = 0.0;         ///< of the Huber weights, of all rows
  double sum_psi_derivative = 0.0;  ///< of psi'(r), of all rows
  int weighted_rows = 0;            ///< rows of these sums: those of far points are left out
  double squares_px = 0.0;          ///< of all residuals
  int rows = 0;                     ///< of all residuals
  int matches = 0;                  ///< points and lines that these are of
  ResidualHistogram points;
  ResidualHistogram lines;
};

/// Covariance of T_prev_curr in ROS' order: translation [m], rotation [rad], along and about the
/// axes of the previous camera.
Matrix6d motionCovariance(const ResidualStatistics& statistics,
                          const Eigen::Isometry3d& T_curr_prev);

}  // namespace point_line_odometry
