#include "motion/prior_factor.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>

#include "geometry/se3.h"

namespace point_line_odometry {
namespace {

// Standard deviations of a motion of which hardly anything is known.
constexpr double kUnknown_m = 100.0;
constexpr double kUnknown_rad = 10.0;

// An axis is known if it is to better than this.
constexpr double kKnown_m = 10.0;
constexpr double kKnown_rad = 1.0;

// Huber's delta of the whole factor, in standard deviations.
constexpr double kHuberDelta = 3.0;

constexpr double kTolerance = 1e-6;  // of rotations and of symmetry

Vector6d perAxis(double translation, double rotation) {
  Vector6d values;
  values << Eigen::Vector3d::Constant(translation), Eigen::Vector3d::Constant(rotation);
  return values;
}

/// Of a motion whose information may be singular: nothing is taken to be less known than by
/// kUnknown_m and kUnknown_rad.
Matrix6d boundedCovariance(const Matrix6d& information) {
  const Vector6d unknown = perAxis(kUnknown_m, kUnknown_rad);
  return fusedCovariance(unknown.cwiseAbs2().asDiagonal(), information);
}

}  // namespace

bool knowsTranslation(const MotionPrior& prior) {
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> eigen(
      prior.information.topLeftCorner<3, 3>(), Eigen::EigenvaluesOnly);
  return eigen.eigenvalues()[1] > 1.0 / (kKnown_m * kKnown_m);
}

bool knowsRotation(const MotionPrior& prior) {
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> eigen(
      prior.information.bottomRightCorner<3, 3>(), Eigen::EigenvaluesOnly);
  return eigen.eigenvalues()[0] > 1.0 / (kKnown_rad * kKnown_rad);
}

bool isUsable(const MotionPrior& prior) {
  const Eigen::Matrix3d R = prior.T_prev_curr.linear();
  const Matrix6d& information = prior.information;
  if (!prior.T_prev_curr.matrix().allFinite() || !information.allFinite()) return false;
  if (!(R * R.transpose()).isIdentity(kTolerance) || R.determinant() < 0.0) return false;
  const double largest = information.cwiseAbs().maxCoeff();
  if ((information - information.transpose()).cwiseAbs().maxCoeff() > kTolerance * largest)
    return false;
  const Eigen::SelfAdjointEigenSolver<Matrix6d> eigen(information, Eigen::EigenvaluesOnly);
  return eigen.eigenvalues().minCoeff() >= -kTolerance * largest;
}

MotionPrior composed(const MotionPrior& first, const MotionPrior& second) {
  MotionPrior both;
  both.from_ns = first.from_ns;
  both.to_ns = second.to_ns;
  both.T_prev_curr = first.T_prev_curr * second.T_prev_curr;
  const auto composedCovariance = [&](const Matrix6d& of_first, const Matrix6d& of_second) {
    return composeCovariance(first.T_prev_curr, of_first, second.T_prev_curr, of_second);
  };
  const Matrix6d none = Matrix6d::Zero();
  const Matrix6d by_first = composedCovariance(boundedCovariance(first.information), none);
  const Matrix6d by_second = composedCovariance(none, boundedCovariance(second.information));
  const double ratio = std::sqrt(by_first.llt().solve(by_second).trace() / 6.0);
  const Matrix6d covariance = (1.0 + ratio) * by_first + (1.0 + 1.0 / ratio) * by_second;
  const Matrix6d inverse = covariance.llt().solve(Matrix6d::Identity());
  both.information = 0.5 * (inverse + inverse.transpose());
  return both;
}

/// (P^-1 + A)^-1 = L (I + L^T A L)^-1 L^T with P = L L^T: A may be singular, and no inverse of a
/// matrix with large and small elements is taken.
Matrix6d fusedCovariance(const Matrix6d& covariance, const Matrix6d& information) {
  const Eigen::LLT<Matrix6d> root(covariance);
  if (root.info() != Eigen::Success) return covariance;
  const Matrix6d L = root.matrixL();
  const Matrix6d inner = Matrix6d::Identity() + L.transpose() * information * L;
  const Eigen::LLT<Matrix6d> inner_root(inner);
  if (inner_root.info() != Eigen::Success) return covariance;
  const Matrix6d half = inner_root.matrixL().solve(L.transpose());
  return half.transpose() * half;
}

PriorFactor::PriorFactor(const MotionPrior& prior) : T_prev_curr_(prior.T_prev_curr) {
  // In units of what counts as known, so that metres and radians are comparable.
  const Vector6d unit = perAxis(kKnown_m, kKnown_rad);
  const Matrix6d scaled = unit.asDiagonal() * prior.information * unit.asDiagonal();
  const Eigen::SelfAdjointEigenSolver<Matrix6d> eigen(0.5 * (scaled + scaled.transpose()));
  const Vector6d values = eigen.eigenvalues().cwiseMax(0.0);
  root_ = values.cwiseSqrt().asDiagonal() * eigen.eigenvectors().transpose() *
          unit.cwiseInverse().asDiagonal();
  axes_ = static_cast<int>((values.array() > 1.0).count());
}

Vector6d PriorFactor::difference(const Eigen::Isometry3d& T_curr_prev) const {
  return poseDifference(T_prev_curr_, T_curr_prev.inverse());
}

PriorFactor::Linearization PriorFactor::linearize(const Eigen::Isometry3d& T_curr_prev) const {
  const Vector6d d = difference(T_curr_prev);
  // The derivatives of R_prev_curr = R^T and t_prev_curr = -R^T t, rotation first.
  const Eigen::Matrix3d R_t = T_curr_prev.linear().transpose();
  Matrix6d J = Matrix6d::Zero();
  J.block<3, 3>(0, 0) = -R_t * skew(T_curr_prev.translation());
  J.block<3, 3>(0, 3) = -R_t;
  J.block<3, 3>(3, 0) = -leftJacobian(d.tail<3>()).inverse() * R_t;
  const Vector6d whitened = root_ * d;
  return {whitened, root_ * J, HuberLoss(whitened.squaredNorm(), kHuberDelta)};
}

Matrix6d PriorFactor::informationAt(const Eigen::Isometry3d& T_curr_prev) const {
  const HuberLoss loss((root_ * difference(T_curr_prev)).squaredNorm(), kHuberDelta);
  return loss.weight * root_.transpose() * root_;
}

/// d^T (P + A^-1)^-1 d = |K d|^2 in the metric (I + K P K^T)^-1 with A = K^T K, which may be
/// singular.
double PriorFactor::chiSquare(const Eigen::Isometry3d& T_curr_prev,
                              const Matrix6d& covariance) const {
  const Vector6d whitened = root_ * difference(T_curr_prev);
  const Matrix6d sum = Matrix6d::Identity() + root_ * covariance * root_.transpose();
  return whitened.dot(sum.llt().solve(whitened));
}

PriorReport PriorFactor::compare(const MotionPrior& prior, const Eigen::Isometry3d& T_prev_curr,
                                 const Matrix6d& covariance) {
  const PriorFactor factor(prior);
  PriorReport report;
  report.axes = factor.axes();
  report.chi_square = factor.chiSquare(T_prev_curr.inverse(), covariance);
  return report;
}

bool PriorFactor::agrees(const PriorReport& report) {
  // Quantiles of the chi-square distribution at 0.9999 with 1 to 6 degrees of freedom.
  constexpr std::array<double, 6> kQuantiles{15.14, 18.42, 21.11, 23.51, 25.74, 27.86};
  const auto last = static_cast<std::size_t>(std::clamp(report.axes, 1, 6) - 1);
  return report.chi_square <= kQuantiles[last];  // false for NaN
}

}  // namespace point_line_odometry
