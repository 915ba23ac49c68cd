#pragma once

#include <ceres/sized_cost_function.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <functional>
#include <optional>
#include <type_traits>
#include <utility>

#include "common/thread_pool.h"
#include "geometry/se3.h"
#include "motion/huber_loss.h"
#include "motion/prior_factor.h"
#include "motion/weighted_matches.h"

namespace point_line_odometry {

/// The parameter blocks of the motion T_curr_prev: rotation vector [rad] and translation [m], so
/// that the rotation can be fixed while the translation is estimated.
struct MotionVector {
  Eigen::Vector3d rotation = Eigen::Vector3d::Zero();
  Eigen::Vector3d translation = Eigen::Vector3d::Zero();

  static MotionVector from(const Eigen::Isometry3d& T_curr_prev);
  Eigen::Isometry3d toIsometry() const;

  /// Derivative of a perturbation (exp(rotation) R, t + translation) of the motion by its
  /// parameters.
  Matrix6d perturbationByParameters() const;
};

/// A cost, and the normal equations of its reweighted residuals r with the Jacobian J by six
/// parameters.
struct MotionEquations {
  double cost = 0.0;                        ///< half of the sum of rho
  Vector6d gradient = Vector6d::Zero();     ///< J^T W r, half of the cost's gradient
  Matrix6d information = Matrix6d::Zero();  ///< J^T W J

  MotionEquations& operator+=(const MotionEquations& other);

  /// The equations by other parameters. \param J derivative of these by the others.
  MotionEquations byParameters(const Matrix6d& J) const;
};

/// The sum of all whitened residuals of a frame, each with a Huber loss (paper, eq. 7-8). The
/// normal equations are those of iteratively reweighted least squares. With residuals of the square
/// rho(s), a step from beyond delta would go twice too far, to the same cost on the other side.
template <ResidualImages kImages>
class MotionCost {
 public:
  using Points = WeightedMatches<PointResidual<kImages>>;
  using Lines = WeightedMatches<LineResidual<kImages>>;

  /// The matches are summed up in this number of parts, whatever the number of threads: the order
  /// of the sums is always the same.
  static constexpr int kParts = 4;

  /// \param points and \param lines must outlive this and stay unchanged.
  /// \param threads sum up the parts; null: the thread that calls.
  MotionCost(const Points& points, const Lines& lines, double huber_delta,
             ThreadPool* threads = nullptr)
      : points_(points), lines_(lines), huber_delta_(huber_delta), threads_(threads) {}

  /// Nothing if a landmark gets behind the camera: the solver takes a smaller step.
  std::optional<MotionEquations> operator()(const MotionVector& motion) const {
    const Eigen::Isometry3d T_curr_prev = motion.toIsometry();
    std::array<MotionEquations, kParts> parts;
    std::array<bool, kParts> valid;
    const auto sum = [&](int part) {
      MotionEquations equations;
      valid[part] = forEachResidual(
          T_curr_prev, part, [&](const auto& r, const auto& J, const HuberLoss& huber) {
            equations.cost += huber.cost;
            equations.gradient.noalias() += huber.weight * J.transpose() * r;
            equations.information.noalias() += huber.weight * J.transpose() * J;
          });
      parts[part] = equations;
    };
    if (threads_ == nullptr) {
      for (int part = 0; part < kParts; ++part) sum(part);
    } else {
      threads_->run(kParts, sum);
    }
    if (std::count(valid.begin(), valid.end(), false) > 0) return std::nullopt;
    MotionEquations all;
    for (const MotionEquations& part : parts) all += part;
    return all.byParameters(motion.perturbationByParameters());
  }

  /// Calls visit(r, J, loss) for the whitened residual of each active match of a part; J is by a
  /// perturbation (exp(rotation) R, t + translation) of T_curr_prev. False as soon as one is not
  /// valid.
  template <typename Visit>
  bool forEachResidual(const Eigen::Isometry3d& T_curr_prev, int part, Visit&& visit) const {
    const auto whiten = [&](const auto& residual, const auto& sqrt_information, const auto&) {
      using Residual = std::decay_t<decltype(residual)>;
      const Eigen::Matrix<double, Residual::kRows, 1> r = sqrt_information * residual.value;
      const typename Residual::JacobianByMotion J = sqrt_information * residual.jacobianByMotion();
      visit(r, J, HuberLoss(r.squaredNorm(), huber_delta_));
    };
    const auto visitPart = [&](const auto& matches) {
      const auto bound = [&](int k) {
        return matches.size() * static_cast<std::size_t>(k) / kParts;
      };
      return matches.forEachActive(T_curr_prev, bound(part), bound(part + 1), whiten);
    };
    return visitPart(points_) && visitPart(lines_);
  }

 private:
  const Points& points_;
  const Lines& lines_;
  double huber_delta_;
  ThreadPool* threads_;
};

/// A cost of the motion and a weak prior as seven residuals, with the same cost, gradient and
/// normal equations J^T J: one cost function instead of hundreds, as Ceres' overhead per residual
/// block would exceed the cost of the residuals. With J^T J = L L^T they are L^-1 J^T r, of
/// Jacobian L^T, and a constant. The prior about the initial motion, with a standard deviation of
/// one unit [rad, m], bounds axes that the matches do not constrain, and is negligible on the
/// others. The factor of a MotionPrior adds to the sums.
class ReducedMotionCost : public ceres::SizedCostFunction<7, 3, 3> {
 public:
  /// Nothing where the cost cannot be evaluated.
  using Cost = std::function<std::optional<MotionEquations>(const MotionVector&)>;

  /// \param prior (null: none) must outlive this.
  ReducedMotionCost(Cost cost, const MotionVector& start, const PriorFactor* prior = nullptr)
      : cost_(std::move(cost)), start_(start), prior_(prior) {}

  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override;

 private:
  struct Linearization {
    MotionVector motion;
    Eigen::Matrix<double, 7, 1> residual;
    Matrix6d jacobian;  // of the first six residuals
  };

  bool linearize(const MotionVector& motion) const;
  MotionEquations ofPriors(const MotionVector& motion) const;

  Cost cost_;
  MotionVector start_;
  const PriorFactor* prior_;
  // The last one: the solver asks for the cost of a step first, for its Jacobian if it takes it.
  mutable std::optional<Linearization> last_;
};

}  // namespace point_line_odometry
