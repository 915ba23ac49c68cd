#pragma once

#include <ceres/sized_cost_function.h>

#include <Eigen/Core>

#include "point_line_odometry/motion.h"
#include "point_line_odometry/pluecker.h"
#include "point_line_odometry/stereo_camera.h"

namespace point_line_odometry {

/// The motion T_curr_prev as the solver sees it: rotation vector [rad] and translation [m], two
/// blocks of three, so that the rotation can be held while the translation is solved for.
struct MotionVector {
  Eigen::Vector3d rotation = Eigen::Vector3d::Zero();
  Eigen::Vector3d translation = Eigen::Vector3d::Zero();

  static MotionVector from(const Eigen::Isometry3d& T_curr_prev);
  Eigen::Isometry3d toIsometry() const;
};

/// Which images of frame k give residuals.
enum class ResidualImages { kLeft, kBoth };

// The residuals below exist once, here; cost functions, weights, outlier test and covariance use
// them. Derivatives are by (rotation about the axes of the current camera, translation): T ->
// (exp(rotation) R, t + translation).

/// Reprojection error of a point (paper, eq. 5) [px]: observed minus projected u, v in the left
/// and, with kBoth, u in the right image (its v repeats the left one in a rectified pair).
struct PointResidual {
  static constexpr int kMaxRows = 3;
  using Vector = Eigen::Matrix<double, Eigen::Dynamic, 1, 0, kMaxRows, 1>;
  using ByMotion = Eigen::Matrix<double, Eigen::Dynamic, 6, 0, kMaxRows, 6>;
  using ByPoint = Eigen::Matrix<double, Eigen::Dynamic, 3, 0, kMaxRows, 3>;

  Vector value;
  ByMotion by_motion;
  ByPoint by_point;    ///< by p_prev
  bool valid = false;  ///< false if the point is not in front of the camera

  PointResidual(const PointCorrespondence& point, const StereoCamera& camera,
                const Eigen::Isometry3d& T_curr_prev, ResidualImages images);
};

/// Distances of the observed end points to the projected line (paper, eq. 4 and 6) [px]: start and
/// end in the left and, with kBoth, start and end in the right image.
struct LineResidual {
  static constexpr int kMaxRows = 4;
  using Vector = Eigen::Matrix<double, Eigen::Dynamic, 1, 0, kMaxRows, 1>;
  using ByMotion = Eigen::Matrix<double, Eigen::Dynamic, 6, 0, kMaxRows, 6>;
  using ByEndPoints = Eigen::Matrix<double, Eigen::Dynamic, 6, 0, kMaxRows, 6>;

  Vector value;
  ByMotion by_motion;
  ByEndPoints by_end_points;  ///< by (start_prev, end_prev)
  bool valid =
      false;  ///< false if the line has no direction in the image, or is not in front of the camera

  LineResidual(const LineCorrespondence& line, const StereoCamera& camera,
               const Eigen::Isometry3d& T_curr_prev, ResidualImages images);
};

/// A residual times the square root of its information, for the solver.
template <typename Correspondence, typename Residual, int kRows>
class WeightedCost : public ceres::SizedCostFunction<kRows, 3, 3> {
 public:
  using SqrtInformation = Eigen::Matrix<double, kRows, kRows>;

  /// \param correspondence must outlive this.
  WeightedCost(const Correspondence& correspondence, const StereoCamera& camera,
               const SqrtInformation& sqrt_information)
      : correspondence_(correspondence), camera_(camera), sqrt_information_(sqrt_information) {}

  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override;

 private:
  const Correspondence& correspondence_;
  const StereoCamera& camera_;
  SqrtInformation sqrt_information_;
};

using PointCostLeft = WeightedCost<PointCorrespondence, PointResidual, 2>;
using PointCostBoth = WeightedCost<PointCorrespondence, PointResidual, 3>;
using LineCostLeft = WeightedCost<LineCorrespondence, LineResidual, 2>;
using LineCostBoth = WeightedCost<LineCorrespondence, LineResidual, 4>;

}  // namespace point_line_odometry
