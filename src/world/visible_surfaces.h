#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <opencv2/core.hpp>
#include <vector>

#include "world/pixel_rays.h"
#include "world/scene.h"

namespace point_line_odometry::world {

/// a X + b Y + c over the normalised image plane.
struct LinearForm {
  float a = 0.0F;
  float b = 0.0F;
  float c = 0.0F;

  float at(const cv::Point2f& p) const { return a * p.x + b * p.y + c; }
};

inline LinearForm operator-(const LinearForm& f, const LinearForm& g) {
  return {f.a - g.a, f.b - g.b, f.c - g.c};
}

/// A rectangle in the normalised image plane.
struct PlaneBlock {
  cv::Point2f centre;
  float half_width = 0.0F;
  float half_height = 0.0F;

  explicit PlaneBlock(const PlaneBounds& b)
      : centre(0.5F * (b.x_low + b.x_high), 0.5F * (b.y_low + b.y_high)),
        half_width(0.5F * (b.x_high - b.x_low)),
        half_height(0.5F * (b.y_high - b.y_low)) {}

  float halfRange(const LinearForm& f) const {
    return std::abs(f.a) * half_width + std::abs(f.b) * half_height;
  }
  float lowest(const LinearForm& f) const { return f.at(centre) - halfRange(f); }
  float highest(const LinearForm& f) const { return f.at(centre) + halfRange(f); }
};

/// A surface in a view. With q = 1 / z of the point that a ray (X, Y, 1) hits, the values
/// q, u q, v q and e q (e: distance inside an edge) are linear in X and Y; the ray hits the polygon
/// if q > 0 and e q >= 0 for all its edges.
struct SeenSurface {
  LinearForm q;
  LinearForm uq;
  LinearForm vq;
  std::array<LinearForm, Surface::kMaxCorners> edges;
  std::size_t num_edges = 0;
  const Material* material = nullptr;
  float light = 1.0F;
  float eye_u = 0.0F;  // the eye over the surface [m]
  float eye_v = 0.0F;
  float eye_height = 1.0F;
};

/// The surfaces that may be visible in a view, and the bounds of their images. Bounds are stored
/// separately, as they are all that is read of most surfaces.
struct VisibleSurfaces {
  std::vector<SeenSurface> surfaces;
  std::vector<PlaneBounds> bounds;
};

/// Surfaces of the scene and of moving objects that face the camera and may be within its image.
VisibleSurfaces findVisibleSurfaces(const Scene& scene, const std::vector<Instance>& movers,
                                    const Eigen::Isometry3d& T_world_camera,
                                    const PlaneBounds& image);

}  // namespace point_line_odometry::world
