#include "odometry/tilt.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <cmath>

#include "geometry/se3.h"

namespace point_line_odometry {

bool isUsable(const TiltCorrection& correction) {
  constexpr double kTolerance = 1e-6;
  return correction.up.allFinite() && correction.rotation.allFinite() &&
         correction.covariance.allFinite() && std::abs(correction.up.norm() - 1.0) < kTolerance &&
         correction.rotation.norm() < 0.5 * M_PI && correction.covariance.trace() >= 0.0;
}

Eigen::Isometry3d aboutPoint(const TiltCorrection& correction, const Eigen::Vector3d& p_odom) {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() = expSO3(correction.rotation);
  T.translation() = p_odom - T.linear() * p_odom;
  return T;
}

/// With L L^T the covariance S of the tilt before, and V D V^T the decomposition of that after it
/// in the metric L: the update keeps F = L V D V^T L^-1 of the error before, as a Kalman filter's
/// would whose measurement leads to that.
Matrix6d correctedCovariance(const Matrix6d& covariance, const TiltCorrection& correction) {
  Eigen::Matrix<double, 2, 6> tilt = Eigen::Matrix<double, 2, 6>::Zero();
  const Eigen::Vector3d first = correction.up.unitOrthogonal();
  tilt.block<1, 3>(0, 3) = first.transpose();
  tilt.block<1, 3>(1, 3) = correction.up.cross(first).transpose();
  const Eigen::LLT<Eigen::Matrix2d> root(tilt * covariance * tilt.transpose());
  if (root.info() != Eigen::Success) return covariance;
  const Eigen::Matrix2d L = root.matrixL();
  const Eigen::Matrix2d wanted =
      tilt.rightCols<3>() * correction.covariance * tilt.rightCols<3>().transpose();
  const Eigen::Matrix2d L_inverse = L.inverse();
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d> eigen(L_inverse * wanted *
                                                             L_inverse.transpose());
  const Eigen::Vector2d share = eigen.eigenvalues().cwiseMax(0.0).cwiseMin(1.0);
  const Eigen::Matrix2d V = eigen.eigenvectors();
  const Eigen::Matrix2d kept = L * V * share.asDiagonal() * V.transpose() * L_inverse;
  const Eigen::Vector2d added_share = share - share.cwiseAbs2();
  const Eigen::Matrix2d added = L * V * added_share.asDiagonal() * V.transpose() * L.transpose();
  const Matrix6d A =
      Matrix6d::Identity() + tilt.transpose() * (kept - Eigen::Matrix2d::Identity()) * tilt;
  const Matrix6d corrected = A * covariance * A.transpose() + tilt.transpose() * added * tilt;
  if (!corrected.allFinite()) return covariance;
  return 0.5 * (corrected + corrected.transpose());
}

}  // namespace point_line_odometry
