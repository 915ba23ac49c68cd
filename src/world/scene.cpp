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

void repeatPatterns(double length_m, Scene* scene) {
  constexpr double kLevel = 0.95;
  for (Object& object : scene->objects) {
    for (Surface& surface : object.surfaces) {
      if (std::abs(surface.axis_u.cross(surface.axis_v).z()) > kLevel)
        surface.material.repetition = static_cast<float>(length_m);
    }
  }
}

}  // namespace point_line_odometry::world
