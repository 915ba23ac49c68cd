#pragma once

#include <Eigen/Geometry>

#include "motion/correspondence.h"
#include "motion/residuals.h"
#include "point_line_odometry/stereo_camera.h"

namespace point_line_odometry {

/// The match with its landmark where both frames together make it most probable at a motion: moved
/// by one Gauss-Newton step in (u, v, disparity) of the previous camera, in which the noise of a
/// triangulated point is normal. `covariance` is moved with it, and `offset_px` is such that the
/// residual stays what it is to first order.
///
/// For estimates from many matches, or over many frames. At the triangulated position the Jacobian
/// has the same error as the residual, and their product does not average out (errors in variables;
/// Fuller, Measurement Error Models, 1987): translations are too short, by the square of the noise
/// of a disparity relative to the disparity, and the calibration of the right camera seems wrong.
///
/// \param match without an offset. One whose disparity has little noise (below 4 % of it), a far
/// one, one behind the camera, and one whose disparity would change by half are returned as they
/// are.
template <ResidualImages kImages>
PointCorrespondence withRefinedLandmark(const PointCorrespondence& match,
                                        const StereoCamera& camera,
                                        const Eigen::Isometry3d& T_curr_prev);

}  // namespace point_line_odometry
