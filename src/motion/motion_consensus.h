#pragma once

#include <Eigen/Geometry>
#include <optional>
#include <vector>

#include "point_line_odometry/motion.h"
#include "point_line_odometry/stereo_camera.h"

namespace point_line_odometry {

/// The motion on which most of some matches agree, of which most may be wrong.
struct MotionConsensus {
  Eigen::Isometry3d T_curr_prev = Eigen::Isometry3d::Identity();
  std::vector<bool> inliers;  ///< one per match
  int num_inliers = 0;
};

/// Looks for it by random samples of three matches (RANSAC, Fischler and Bolles 1981; P3P), scored
/// by the reprojection in both images. The same matches give the same motion. Nothing if it has
/// fewer than kMinConsensus inliers: wrong matches alone do not agree so often.
std::optional<MotionConsensus> findConsensus(const std::vector<PointCorrespondence>& matches,
                                             const StereoCamera& camera);

constexpr int kMinConsensus = 8;

}  // namespace point_line_odometry
