#include "world/scene.h"

#include <algorithm>
#include <cmath>

namespace point_line_odometry::world {

std::vector<Instance> poseMovers(const Scene& scene, double time_s, double camera_m) {
  std::vector<Instance> placed;
  for (const Mover& mover : scene.movers) {
    const double arc_m =
        std::max(mover.start_m + mover.speed_m_s * time_s, camera_m + mover.least_gap_m);
    Eigen::Isometry3d pose = scene.trajectory.at(arc_m);
    pose.translation() += mover.to_the_left_m * pose.linear().col(1);
    pose.translation().z() = scene.hill.heightAt(pose.translation().x());
    if (mover.speed_m_s < 0.0) {
      pose.linear() = pose.linear() * Eigen::AngleAxisd(M_PI, Eigen::Vector3d::UnitZ());
    }
    placed.push_back({mover.object, pose});
  }
  return placed;
}

}  // namespace point_line_odometry::world
