#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <algorithm>
#include <vector>

#include "geometry/se3.h"
#include "map/bundle_adjustment.h"

namespace point_line_odometry {

/// \file
/// The poses of a bundle adjustment, and the normal equations of their increments. Increments and
/// Jacobians are of (rotation, translation): T_camera_map = (exp(rotation) R_0, t_0 + translation).

/// A frame's pose at an increment from the initial one.
struct BundlePose {
  static constexpr int kFixed = -1;

  Eigen::Isometry3d T_camera_map_start;
  int index;  ///< among the poses that are estimated, or kFixed
  Vector6d increment = Vector6d::Zero();
  Eigen::Isometry3d T_camera_map;
  /// Of the rotation's increment: from perturbations of exp(rotation) to those of the rotation.
  Eigen::Matrix3d left_jacobian = Eigen::Matrix3d::Identity();

  BundlePose(const Eigen::Isometry3d& T_map_camera, int index_of_this)
      : T_camera_map_start(T_map_camera.inverse()),
        index(index_of_this),
        T_camera_map(T_camera_map_start) {}

  bool fixed() const { return index == kFixed; }

  void add(const Vector6d& step) {
    increment += step;
    const Eigen::Vector3d rotation = increment.head<3>();
    T_camera_map.linear() = expSO3(rotation) * T_camera_map_start.linear();
    T_camera_map.translation() = T_camera_map_start.translation() + increment.tail<3>();
    left_jacobian = leftJacobian(rotation);
  }

  /// From the Jacobian by a perturbation T -> (exp(rotation) R, t + translation), as residuals have
  /// it, to that by the increment.
  template <int kRows>
  Eigen::Matrix<double, kRows, 6> byIncrement(const Eigen::Matrix<double, kRows, 6>& J) const {
    Eigen::Matrix<double, kRows, 6> J_increment = J;
    J_increment.template leftCols<3>() = J.template leftCols<3>() * left_jacobian;
    return J_increment;
  }
};

/// What Levenberg-Marquardt adds to the diagonal of the normal equations: its share 1 / radius,
/// bounded so that parameters without a residual have a solution.
template <typename Diagonal>
auto damping(const Diagonal& diagonal, double radius) {
  constexpr double kSmallest = 1e-6;
  constexpr double kLargest = 1e32;
  return (diagonal.cwiseMax(kSmallest).cwiseMin(kLargest) / radius).eval();
}

/// Normal equations H step = -g of the estimated poses.
class PoseSystem {
 public:
  explicit PoseSystem(int num_poses)
      : H_(Eigen::MatrixXd::Zero(6 * num_poses, 6 * num_poses)),
        g_(Eigen::VectorXd::Zero(6 * num_poses)) {}

  void setZero() {
    H_.setZero();
    g_.setZero();
  }

  /// Adds to the block of two poses; of blocks (i, k) and (k, i) one only, with i >= k.
  template <typename Block>
  void add(int i, int k, const Block& block) {
    H_.block<6, 6>(6 * i, 6 * k) += block;
  }
  template <typename Gradient>
  void addGradient(int i, const Gradient& gradient) {
    g_.segment<6>(6 * i) += gradient;
  }

  /// Adds the damping() to the diagonal, and returns it.
  Eigen::VectorXd damp(double radius) {
    Eigen::VectorXd added = damping(H_.diagonal(), radius);
    H_.diagonal() += added;
    return added;
  }

  const Eigen::VectorXd& gradient() const { return g_; }

  /// Not finite if the equations have no solution.
  Eigen::VectorXd solve() const { return -H_.llt().solve(g_); }

 private:
  Eigen::MatrixXd H_;  // lower triangle
  Eigen::VectorXd g_;
};

/// Relative-pose factor: difference of the motion between two poses from a given one, as
/// translation along and rotation about the axes of the second, times the square-root information.
class RelativePoseFactor {
 public:
  explicit RelativePoseFactor(const BundleProblem::Motion& motion);

  /// True if the residual at the poses and the square-root information are finite.
  bool usable(const std::vector<BundlePose>& poses) const;

  double cost(const std::vector<BundlePose>& poses) const;
  void linearize(const std::vector<BundlePose>& poses, PoseSystem* system) const;

 private:
  struct Error;
  Error errorAt(const std::vector<BundlePose>& poses) const;

  int from_;
  int to_;
  Eigen::Isometry3d T_to_from_known_;
  Matrix6d sqrt_information_;
};

}  // namespace point_line_odometry
