#include "motion/motion_cost.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

#include "geometry/se3.h"

namespace point_line_odometry {

MotionVector MotionVector::from(const Eigen::Isometry3d& T_curr_prev) {
  return {logSO3(T_curr_prev.linear()), T_curr_prev.translation()};
}

Eigen::Isometry3d MotionVector::toIsometry() const {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() = expSO3(rotation);
  T.translation() = translation;
  return T;
}

Matrix6d MotionVector::perturbationByParameters() const {
  Matrix6d J = Matrix6d::Identity();
  J.topLeftCorner<3, 3>() = leftJacobian(rotation);
  return J;
}

MotionEquations& MotionEquations::operator+=(const MotionEquations& other) {
  cost += other.cost;
  gradient += other.gradient;
  information += other.information;
  return *this;
}

MotionEquations MotionEquations::byParameters(const Matrix6d& J) const {
  return {cost, J.transpose() * gradient, J.transpose() * information * J};
}

/// The weak prior about the initial motion, and the factor.
MotionEquations ReducedMotionCost::ofPriors(const MotionVector& motion) const {
  MotionEquations equations;
  equations.gradient << motion.rotation - start_.rotation, motion.translation - start_.translation;
  equations.cost = 0.5 * equations.gradient.squaredNorm();
  equations.information = Matrix6d::Identity();
  if (prior_ == nullptr) return equations;
  const PriorFactor::Linearization prior = prior_->linearize(motion.toIsometry());
  const Matrix6d J_prior = (prior.jacobian * motion.perturbationByParameters()).eval();
  equations += {prior.loss.cost, prior.loss.weight * J_prior.transpose() * prior.residual,
                prior.loss.weight * J_prior.transpose() * J_prior};
  return equations;
}

bool ReducedMotionCost::linearize(const MotionVector& motion) const {
  const auto is = [&](const MotionVector& other) {
    return motion.rotation == other.rotation && motion.translation == other.translation;
  };
  if (last_ && is(last_->motion)) return true;
  last_.reset();
  std::optional<MotionEquations> equations = cost_(motion);
  if (!equations) return false;
  *equations += ofPriors(motion);
  const Eigen::LLT<Matrix6d> root(equations->information);
  if (root.info() != Eigen::Success) return false;
  Linearization linearization;
  linearization.motion = motion;
  const Vector6d explained = root.matrixL().solve(equations->gradient);
  linearization.residual << explained,
      std::sqrt(std::max(2.0 * equations->cost - explained.squaredNorm(), 0.0));
  linearization.jacobian = root.matrixU();
  last_ = linearization;
  return true;
}

bool ReducedMotionCost::Evaluate(double const* const* parameters, double* residuals,
                                 double** jacobians) const {
  using Vector7d = Eigen::Matrix<double, 7, 1>;
  using Jacobian = Eigen::Matrix<double, 7, 3, Eigen::RowMajor>;
  if (!linearize({Eigen::Map<const Eigen::Vector3d>(parameters[0]),
                  Eigen::Map<const Eigen::Vector3d>(parameters[1])}))
    return false;
  Eigen::Map<Vector7d> value(residuals);
  value = last_->residual;
  for (const int block : {0, 1}) {
    if (jacobians == nullptr || jacobians[block] == nullptr) continue;
    Eigen::Map<Jacobian> J(jacobians[block]);
    J.topRows<6>() = last_->jacobian.middleCols<3>(3 * block);
    J.row(6).setZero();
  }
  return true;
}

}  // namespace point_line_odometry
