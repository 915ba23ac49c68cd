#pragma once

#include <Eigen/Geometry>
#include <optional>
#include <vector>

#include "motion/correspondence.h"
#include "point_line_odometry/stereo_camera.h"

namespace point_line_odometry {

/// The motion with the most inliers among matches that may be mostly wrong.
struct MotionConsensus {
  Eigen::Isometry3d T_curr_prev = Eigen::Isometry3d::Identity();
  std::vector<bool> inliers;  ///< one per match
  int num_inliers = 0;
};

/// Estimates it by RANSAC (Fischler and Bolles 1981) over P3P of three matches, scored by the
/// reprojection errors in both images. The same matches give the same motion. Nothing if it has
/// fewer than kMinConsensus inliers: wrong matches rarely reach that number.
std::optional<MotionConsensus> findConsensus(const std::vector<PointCorrespondence>& matches,
                                             const StereoCamera& camera);

/// The same from matches of points too far for a depth, which constrain the rotation only: RANSAC
/// over two matches, with the current camera at a position of the previous camera's frame that is
/// known roughly [m].
std::optional<MotionConsensus> findRotation(const std::vector<PointCorrespondence>& far_matches,
                                            const StereoCamera& camera,
                                            const Eigen::Vector3d& position_prev);

constexpr int kMinConsensus = 8;

/// The matches that a motion does not explain, within twice the error of an inlier. RANSAC over
/// them finds another motion (sequential RANSAC).
std::vector<PointCorrespondence> outliersOf(const std::vector<PointCorrespondence>& matches,
                                            const StereoCamera& camera,
                                            const Eigen::Isometry3d& T_curr_prev);

}  // namespace point_line_odometry
