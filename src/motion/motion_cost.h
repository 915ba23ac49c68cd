#pragma once

#include <ceres/cost_function.h>
#include <ceres/sized_cost_function.h>

#include <Eigen/Geometry>

#include "geometry/skew.h"
#include "motion/weighted_matches.h"

namespace point_line_odometry {

/// The motion T_curr_prev as the solver sees it: rotation vector [rad] and translation [m], two
/// blocks of three, so that the rotation can be held while the translation is solved for.
struct MotionVector {
  Eigen::Vector3d rotation = Eigen::Vector3d::Zero();
  Eigen::Vector3d translation = Eigen::Vector3d::Zero();

  static MotionVector from(const Eigen::Isometry3d& T_curr_prev);
  Eigen::Isometry3d toIsometry() const;
};

/// Left Jacobian of the rotation: exp(w + dw) = exp(J dw) exp(w).
Eigen::Matrix3d leftJacobian(const Eigen::Vector3d& w);

/// Factor g(s) by which a residual with the square norm s is scaled so that its square is Huber's
/// function of it, and twice the derivative of g by s.
struct HuberScale {
  double scale = 1.0;
  double twice_derivative = 0.0;

  HuberScale(double squared_norm, double delta);
};

/// Holds a block of the motion near where the solver starts, with a standard deviation of one unit
/// [rad, m]: along an axis that the matches do not show, it would run away. Next to what they do
/// say, this is nothing. (Not ceres::NormalPrior: it allocates in Ceres' library what the caller's
/// code frees, and Eigen's way of doing either depends on how each of them was compiled.)
class NearStart : public ceres::SizedCostFunction<3, 3> {
 public:
  explicit NearStart(const Eigen::Vector3d& start) : start_(start) {}

  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override {
    Eigen::Map<Eigen::Vector3d> residual(residuals);
    residual = Eigen::Map<const Eigen::Vector3d>(parameters[0]) - start_;
    if (jacobians != nullptr && jacobians[0] != nullptr) {
      Eigen::Map<Eigen::Matrix3d>(jacobians[0]).setIdentity();
    }
    return true;
  }

 private:
  Eigen::Vector3d start_;
};

/// All weighted residuals of a frame as one cost of the solver, each under a Huber kernel (paper,
/// eq. 7-8). One cost instead of hundreds: the solver's own work per cost would take longer than
/// the residuals.
template <ResidualImages kImages>
class MotionCost : public ceres::CostFunction {
 public:
  using Points = WeightedMatches<PointResidual<kImages>>;
  using Lines = WeightedMatches<LineResidual<kImages>>;

  /// \param points and \param lines must outlive this, and not change meanwhile.
  MotionCost(const Points& points, const Lines& lines, double huber_delta)
      : points_(points), lines_(lines), huber_delta_(huber_delta) {
    set_num_residuals(points.rows() + lines.rows());
    *mutable_parameter_block_sizes() = {3, 3};
  }

  /// False if a landmark gets behind the camera: the solver takes a smaller step.
  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override {
    const MotionVector motion{Eigen::Map<const Eigen::Vector3d>(parameters[0]),
                              Eigen::Map<const Eigen::Vector3d>(parameters[1])};
    const Eigen::Isometry3d T_curr_prev = motion.toIsometry();
    Rows rows{residuals, jacobians == nullptr ? nullptr : jacobians[0],
              jacobians == nullptr ? nullptr : jacobians[1], leftJacobian(motion.rotation)};
    const auto write = [&](const auto& residual, const auto& weight, const auto&) {
      writeRows(residual, weight, &rows);
    };
    return points_.forEachActive(T_curr_prev, write) && lines_.forEachActive(T_curr_prev, write);
  }

 private:
  /// Where the next residual and its derivatives are written (row-major, three columns).
  struct Rows {
    double* residual;
    double* by_rotation;
    double* by_translation;
    Eigen::Matrix3d left_jacobian;
  };

  template <typename Residual, typename Weight>
  void writeRows(const Residual& residual, const Weight& weight, Rows* rows) const {
    constexpr int kRows = Residual::kRows;
    using Vector = Eigen::Matrix<double, kRows, 1>;
    using Jacobian = Eigen::Matrix<double, kRows, 3, Eigen::RowMajor>;
    const Vector whitened = weight * residual.value;
    const HuberScale huber(whitened.squaredNorm(), huber_delta_);
    Eigen::Map<Vector>(rows->residual) = huber.scale * whitened;
    rows->residual += kRows;
    const auto robust = [&](const Jacobian& J) -> Jacobian {
      return huber.scale * J + huber.twice_derivative * whitened * (whitened.transpose() * J);
    };
    if (rows->by_rotation == nullptr && rows->by_translation == nullptr) return;
    const Eigen::Matrix<double, kRows, 6> by_motion = weight * residual.byMotion();
    if (rows->by_rotation != nullptr) {
      const Jacobian J = by_motion.template leftCols<3>() * rows->left_jacobian;
      Eigen::Map<Jacobian>(rows->by_rotation) = robust(J);
      rows->by_rotation += 3 * kRows;
    }
    if (rows->by_translation != nullptr) {
      const Jacobian J = by_motion.template rightCols<3>();
      Eigen::Map<Jacobian>(rows->by_translation) = robust(J);
      rows->by_translation += 3 * kRows;
    }
  }

  const Points& points_;
  const Lines& lines_;
  double huber_delta_;
};

}  // namespace point_line_odometry
