#pragma once

#include <Eigen/Geometry>
#include <optional>

#include "world/visible_surfaces.h"

namespace point_line_odometry::world {

/// Reference implementation: intersects each ray of a camera with the scene separately.
class RayCaster {
 public:
  RayCaster(const Scene& scene, const Eigen::Isometry3d& T_world_camera, const PlaneBounds& image)
      : T_world_camera_(T_world_camera),
        visible_(findVisibleSurfaces(scene, {}, T_world_camera, image)) {}

  /// Point in the world [m] that the ray (x, y, 1) of the camera hits; nothing: the sky.
  std::optional<Eigen::Vector3d> hit(const cv::Point2f& p) const {
    float nearest_q = 0.0F;
    for (std::size_t i = 0; i < visible_.surfaces.size(); ++i) {
      const PlaneBounds& b = visible_.bounds[i];
      if (p.x < b.x_low || p.x > b.x_high || p.y < b.y_low || p.y > b.y_high) continue;
      const SeenSurface& surface = visible_.surfaces[i];
      const float q = surface.q.at(p);
      if (q > nearest_q && inside(surface, p)) nearest_q = q;
    }
    if (nearest_q <= 0.0F) return std::nullopt;
    return T_world_camera_ * (Eigen::Vector3d(p.x, p.y, 1.0) / static_cast<double>(nearest_q));
  }

 private:
  static bool inside(const SeenSurface& surface, const cv::Point2f& p) {
    for (std::size_t i = 0; i < surface.num_edges; ++i) {
      if (surface.edges[i].at(p) < 0.0F) return false;
    }
    return true;
  }

  Eigen::Isometry3d T_world_camera_;
  VisibleSurfaces visible_;
};

}  // namespace point_line_odometry::world
