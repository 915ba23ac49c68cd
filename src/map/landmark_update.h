#pragma once

#include <Eigen/Geometry>

#include "map/landmarks.h"
#include "motion/observations.h"
#include "point_line_odometry/stereo_camera.h"
#include "point_line_odometry/types.h"

namespace point_line_odometry {

/// EKF update of a landmark by an observation from a pose. Returns false if the landmark is or gets
/// behind the camera, where the linearisation is invalid, as for an end point of a line with a
/// large variance along its ray.
/// \param pose_covariance of T_map_camera: along and about the axes of the camera.
bool ekfUpdate(const StereoCamera& camera, const Eigen::Isometry3d& T_camera_map,
               const Matrix6d& pose_covariance, const PointObservation& observation,
               PointEstimate* estimate);
bool ekfUpdate(const StereoCamera& camera, const Eigen::Isometry3d& T_camera_map,
               const Matrix6d& pose_covariance, const LineObservation& observation,
               LineEstimate* estimate);

}  // namespace point_line_odometry
