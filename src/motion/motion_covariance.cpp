#include "motion/motion_covariance.h"

#include <Eigen/Eigenvalues>
#include <algorithm>

#include "geometry/se3.h"

namespace point_line_odometry {
namespace {

// Prior of the variance factor: counts as this many residuals of variance 1.
constexpr double kPriorResiduals = 20.0;

// Share of a point's noise that comes from the pixels of the current image. The other half is that
// of the patch, which is another image's.
constexpr double kNoiseOfImage = 0.5;

// A few matches of one place may be wrong together, by as much as inliers may be: of an edge that
// covers another, of a texture that repeats. The fewer the others are, the more they move the
// motion: the variance is larger by 1 + this / matches, as six neighbours that are three standard
// deviations wrong make it.
constexpr double kVarianceOfFewMatches = 36.0;

/// Least information [1/m^2, 1/rad^2] of a direction: one that is unconstrained is known to 1 km or
/// 1000 rad. A double resolves no more of it beside the other directions.
constexpr double kLeastInformation = 1e-6;

/// The inverse; unconstrained directions get a large variance.
Matrix6d invert(const Matrix6d& information) {
  const Eigen::SelfAdjointEigenSolver<Matrix6d> eigen(information);
  const double floor = std::max(1e-15 * eigen.eigenvalues().maxCoeff(), kLeastInformation);
  return eigen.eigenvectors() * eigen.eigenvalues().cwiseMax(floor).cwiseInverse().asDiagonal() *
         eigen.eigenvectors().transpose();
}

/// Variance factor of the inverse information matrix: estimated from the residuals of an M-estimate
/// with Huber weights (Huber, Robust Statistics, 1981, section 7.6; the loss of a norm reduces the
/// derivative along the residual only), with a prior of 1.
double varianceFactor(const ResidualStatistics& statistics) {
  const double degrees_of_freedom = std::max(statistics.weighted_rows - 6, 0);
  if (!(statistics.sum_psi_derivative > 0.0) || !(degrees_of_freedom > 0.0)) return 1.0;
  const double observed = statistics.sum_psi2 * statistics.sum_weights * statistics.weighted_rows /
                          (statistics.sum_psi_derivative * statistics.sum_psi_derivative);
  return (observed + kPriorResiduals) / (degrees_of_freedom + kPriorResiduals);
}

/// Covariance of J^T r by the error of the velocity in a rolling shutter. In the frame from which
/// landmarks are it is as large.
Matrix6d velocityError(const NormalEquations& equations, const RollingShutter& shutter,
                       const Eigen::Isometry3d& T_curr_prev) {
  if (shutter.isGlobal()) return Matrix6d::Zero();
  constexpr double kFrames = 2.0;
  // The solver rotates about the axes before the translation, the velocity after it.
  Matrix6d perturbation_by_velocity = Matrix6d::Identity();
  perturbation_by_velocity.bottomLeftCorner<3, 3>() = -skew(T_curr_prev.translation());
  Vector6d variances;
  variances << shutter.variances().tail<3>(), shutter.variances().head<3>();
  const Matrix6d by_velocity = equations.by_velocity * perturbation_by_velocity;
  return kFrames * by_velocity * variances.asDiagonal() * by_velocity.transpose();
}

}  // namespace

NormalEquations& NormalEquations::operator+=(const NormalEquations& other) {
  information += other.information;
  shift_of_far += other.shift_of_far;
  by_disparity += other.by_disparity;
  by_velocity += other.by_velocity;
  correlation += other.correlation;
  return *this;
}

NormalEquations& NormalEquations::operator-=(const NormalEquations& other) {
  information -= other.information;
  shift_of_far -= other.shift_of_far;
  by_disparity -= other.by_disparity;
  by_velocity -= other.by_velocity;
  correlation -= other.correlation;
  return *this;
}

/// The estimate solves (information + shift_of_far) x = -J^T r, where J^T r has the covariance
/// information + correlation.
Matrix6d NormalEquations::covariance(Matrix6d* gain) const {
  const Matrix6d inverse = invert(information);
  const Matrix6d by_inverse =
      Matrix6d(Matrix6d::Identity() + inverse * shift_of_far).partialPivLu().inverse();
  *gain = by_inverse * inverse;
  Matrix6d covariance = *gain * by_inverse.transpose() + *gain * correlation * gain->transpose();
  if (covariance.allFinite()) return covariance;
  *gain = invert(Matrix6d::Zero());  // nothing is constrained
  return *gain;
}

std::size_t ImageInformation::partAt(const Eigen::Vector2d& left_px) {
  const Eigen::Vector2i cell = (left_px / part_px_).array().floor().cast<int>();
  const auto at = std::find_if(parts_.begin(), parts_.end(),
                               [&](const Part& part) { return part.cell == cell; });
  const auto index = static_cast<std::size_t>(at - parts_.begin());
  if (at == parts_.end()) parts_.push_back({cell, {}});
  return index;
}

void ImageInformation::add(const Eigen::Vector2d& left_px, const NormalEquations& equations) {
  whole_ += equations;
  parts_[partAt(left_px)].equations += equations;
}

void ImageInformation::addCorrelations(const std::vector<PatchJacobian>& patches) {
  std::vector<PatchArea> areas;
  for (const PatchJacobian& patch : patches) areas.push_back(patch.area);
  forEachOverlap(areas, [&](std::size_t i, std::size_t j, double overlap) {
    const Matrix6d half = kNoiseOfImage * overlap * patches[i].J.transpose() * patches[j].J;
    NormalEquations pair;
    pair.correlation = half + half.transpose();
    whole_ += pair;
    const std::size_t part_of_i = partAt(areas[i].center_px);
    const std::size_t part_of_j = partAt(areas[j].center_px);
    parts_[part_of_i].equations += pair;
    if (part_of_j != part_of_i) parts_[part_of_j].equations += pair;
  });
}

NormalEquations ImageInformation::withoutMostInfluentialPart() const {
  if (parts_.empty()) return whole_;
  const Matrix6d covariance = invert(whole_.information);
  const auto influence = [&](const Part& part) {
    return covariance.cwiseProduct(part.equations.information).sum();
  };
  const auto most =
      std::max_element(parts_.begin(), parts_.end(),
                       [&](const Part& a, const Part& b) { return influence(a) < influence(b); });
  NormalEquations others = whole_;
  others -= most->equations;
  return others;
}

Matrix6d motionCovariance(const ResidualStatistics& statistics,
                          const Eigen::Isometry3d& T_curr_prev) {
  Matrix6d gain;
  const NormalEquations equations = statistics.information.withoutMostInfluentialPart();
  const Matrix6d inverse = equations.covariance(&gain);
  const double scale =
      varianceFactor(statistics) * (1.0 + kVarianceOfFewMatches / std::max(statistics.matches, 1));
  const Vector6d calibration_error = statistics.disparity_error_px * gain * equations.by_disparity;
  const Matrix6d of_perturbation =
      scale * inverse + calibration_error * calibration_error.transpose() +
      gain * velocityError(equations, statistics.shutter, T_curr_prev) * gain.transpose();

  // R_prev_curr = R^T and t_prev_curr = -R^T t under (exp(rotation) R, t + translation).
  const Eigen::Matrix3d R_t = T_curr_prev.linear().transpose();
  const Eigen::Vector3d& t = T_curr_prev.translation();
  Matrix6d J = Matrix6d::Zero();
  J.block<3, 3>(0, 0) = -R_t * skew(t);
  J.block<3, 3>(0, 3) = -R_t;
  J.block<3, 3>(3, 0) = -R_t;
  const Matrix6d covariance = J * of_perturbation * J.transpose();
  return 0.5 * (covariance + covariance.transpose());
}

}  // namespace point_line_odometry
