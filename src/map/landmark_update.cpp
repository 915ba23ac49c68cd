#include "map/landmark_update.h"

#include "geometry/se3.h"
#include "motion/residuals.h"

namespace point_line_odometry {
namespace {

/// Derivative of a landmark's coordinates by the pose from which it is seen: the shift, along and
/// about the camera's axes, that has the same effect on its pixels.
template <int kSize, int kDof>
Eigen::Matrix<double, kSize, 6> landmarkByPose(const GaussianEstimate<kSize, kDof>& estimate,
                                               const Eigen::Isometry3d& T_camera_map) {
  const Eigen::Matrix3d R_map_camera = T_camera_map.linear().transpose();
  Eigen::Matrix<double, kSize, 6> J;
  for (int i = 0; i < kSize; i += 3) {
    const Eigen::Vector3d p_camera = T_camera_map * estimate.value.template segment<3>(i).eval();
    J.template block<3, 3>(i, 0) = -R_map_camera;
    J.template block<3, 3>(i, 3) = R_map_camera * skew(p_camera);
  }
  return J;
}

template <typename Residual, typename Estimate, typename Observation>
bool update(const StereoCamera& camera, const Eigen::Isometry3d& T_camera_map,
            const Matrix6d& pose_covariance, const Observation& observation, Estimate* estimate) {
  const Residual residual(correspondence(*estimate, observation), camera, T_camera_map);
  if (!residual.valid) return false;
  using Noise = Eigen::Matrix<double, Residual::kRows, Residual::kRows>;
  const auto J = residual.jacobianByLandmark();
  const auto J_pose = (J * landmarkByPose(*estimate, T_camera_map)).eval();
  const Noise noise = observation.sigma_px * observation.sigma_px * Noise::Identity() +
                      J_pose * pose_covariance * J_pose.transpose();
  estimate->template update<Residual::kRows>(residual.value, J, noise);
  return Residual(correspondence(*estimate, observation), camera, T_camera_map).valid;
}

}  // namespace

bool ekfUpdate(const StereoCamera& camera, const Eigen::Isometry3d& T_camera_map,
               const Matrix6d& pose_covariance, const PointObservation& observation,
               PointEstimate* estimate) {
  return update<PointResidual<ResidualImages::kBoth>>(camera, T_camera_map, pose_covariance,
                                                      observation, estimate);
}

bool ekfUpdate(const StereoCamera& camera, const Eigen::Isometry3d& T_camera_map,
               const Matrix6d& pose_covariance, const LineObservation& observation,
               LineEstimate* estimate) {
  return update<LineResidual<ResidualImages::kBoth>>(camera, T_camera_map, pose_covariance,
                                                     observation, estimate);
}

}  // namespace point_line_odometry
