#pragma once

#include <Eigen/Geometry>

#include "motion/huber_loss.h"
#include "point_line_odometry/motion_prior.h"
#include "point_line_odometry/types.h"

namespace point_line_odometry {

/// Whether a prior knows the translation to 10 m, along two axes at least: wheels need not measure
/// their z, and a flat floor determines only that.
bool knowsTranslation(const MotionPrior& prior);

/// Whether a prior knows the rotation about all axes, to one radian.
bool knowsRotation(const MotionPrior& prior);

/// Whether the numbers of a prior can be used: finite, a rotation, a symmetric information matrix
/// without negative eigenvalues.
bool isUsable(const MotionPrior& prior);

/// The prior of two motions in a row. What one of them does not know is known of neither. How far
/// their errors are the same ones, as by a gyroscope's bias or a wheel's radius, is unknown: the
/// covariance is a bound of all cases (n equal motions: n^2 times that of one).
MotionPrior composed(const MotionPrior& first, const MotionPrior& second);

/// Covariance of an estimate that is fused with independent information, from its own.
Matrix6d fusedCovariance(const Matrix6d& covariance, const Matrix6d& information);

/// A relative-pose factor: the whitened difference of the motion from that of a prior, with a Huber
/// loss of the whole, so that its pull is bounded and never more than its information says.
class PriorFactor {
 public:
  /// \param prior usable.
  explicit PriorFactor(const MotionPrior& prior);

  struct Linearization {
    Vector6d residual;  ///< whitened, before the loss
    Matrix6d jacobian;  ///< by a perturbation (exp(rotation) R, t + translation) of T_curr_prev
    HuberLoss loss;
  };
  Linearization linearize(const Eigen::Isometry3d& T_curr_prev) const;

  /// Information at a motion: that of the prior, less where the Huber loss is beyond its square.
  Matrix6d informationAt(const Eigen::Isometry3d& T_curr_prev) const;

  /// Number of axes that it knows to better than 10 m or 1 rad.
  int axes() const { return axes_; }

  /// Squared Mahalanobis distance from an independent estimate. \param covariance of its
  /// T_prev_curr, along and about the axes of the previous camera.
  double chiSquare(const Eigen::Isometry3d& T_curr_prev, const Matrix6d& covariance) const;

  /// The same of a prior and an estimate, with the number of axes.
  static PriorReport compare(const MotionPrior& prior, const Eigen::Isometry3d& T_prev_curr,
                             const Matrix6d& covariance);

  /// Whether an independent estimate is within the error that both admit to: false for one in 10000
  /// of them.
  static bool agrees(const PriorReport& report);

  /// Whether a motion was estimated with a prior that knows all its axes.
  static bool usesAllAxes(const PriorReport& report) {
    return report.use == PriorUse::kUsed && report.axes == 6;
  }

 private:
  Vector6d difference(const Eigen::Isometry3d& T_curr_prev) const;

  Eigen::Isometry3d T_prev_curr_;
  Matrix6d root_;  // information = root^T root
  int axes_ = 0;
};

}  // namespace point_line_odometry
