#include "world/visible_surfaces.h"

#include <algorithm>
#include <utility>

namespace point_line_odometry::world {
namespace {

using Eigen::Vector3d;

LinearForm toForm(const Vector3d& v) {
  return {static_cast<float>(v.x()), static_cast<float>(v.y()), static_cast<float>(v.z())};
}

/// Collects the surfaces in view of a camera.
class Finder {
 public:
  Finder(const Scene& scene, const Eigen::Isometry3d& T_world_camera, const PlaneBounds& image)
      : scene_(scene), T_camera_world_(T_world_camera.inverse()), image_(image) {}

  void add(const Instance& instance) {
    const Object& object = scene_.objects[instance.object];
    const Vector3d centre = T_camera_world_ * (instance.T_world_object * object.centre);
    if (centre.norm() - object.radius_m > object.visible_m) return;
    if (!touchesView(centre, object.radius_m)) return;
    const Eigen::Isometry3d T_camera_object = T_camera_world_ * instance.T_world_object;
    const Vector3d towards_light = T_camera_world_.linear() * scene_.lighting.direction;
    for (const Surface& surface : object.surfaces) add(surface, T_camera_object, towards_light);
  }

  VisibleSurfaces take() { return std::move(visible_); }

 private:
  /// False if a sphere in the camera's frame is outside the view frustum.
  bool touchesView(const Vector3d& centre, double radius) const {
    const auto outside = [&](double tangent, double x, double sign) {
      return sign * (x - tangent * centre.z()) > radius * std::sqrt(1.0 + tangent * tangent);
    };
    return centre.z() > -radius && !outside(image_.x_low, centre.x(), -1.0) &&
           !outside(image_.x_high, centre.x(), 1.0) && !outside(image_.y_low, centre.y(), -1.0) &&
           !outside(image_.y_high, centre.y(), 1.0);
  }

  void add(const Surface& surface, const Eigen::Isometry3d& T_camera_object,
           const Vector3d& towards_light) {
    constexpr double kNearest_m = 1e-3;
    const Vector3d o = T_camera_object * surface.origin;
    const Vector3d a = T_camera_object.linear() * surface.axis_u;
    const Vector3d b = T_camera_object.linear() * surface.axis_v;
    const Vector3d n = a.cross(b);
    const double eye_height = -n.dot(o);
    if (eye_height < kNearest_m) return;  // seen from behind
    const Vector3d q = -n / eye_height;
    const Vector3d uq = a - a.dot(o) * q;
    const Vector3d vq = b - b.dot(o) * q;
    SeenSurface seen;
    seen.q = toForm(q);
    seen.num_edges = surface.num_corners;
    for (std::size_t i = 0; i < seen.num_edges; ++i) {
      const Eigen::Vector2d from = surface.corners[i].cast<double>();
      const Eigen::Vector2d to = surface.corners[(i + 1) % seen.num_edges].cast<double>();
      const Eigen::Vector2d inward(from.y() - to.y(), to.x() - from.x());
      seen.edges[i] = toForm(inward.x() * uq + inward.y() * vq - inward.dot(from) * q);
      if (PlaneBlock(image_).highest(seen.edges[i]) < 0.0F) return;
    }
    if (PlaneBlock(image_).highest(seen.q) <= 0.0F) return;
    seen.uq = toForm(uq);
    seen.vq = toForm(vq);
    seen.material = &surface.material;
    seen.light = lightOn(surface.material, n.dot(towards_light));
    seen.eye_u = static_cast<float>(-a.dot(o));
    seen.eye_v = static_cast<float>(-b.dot(o));
    seen.eye_height = static_cast<float>(eye_height);
    visible_.surfaces.push_back(seen);
    visible_.bounds.push_back(boundsOf(surface, T_camera_object));
  }

  /// Bounds of a surface's image; everything if a part of it is not in front of the camera.
  static PlaneBounds boundsOf(const Surface& surface, const Eigen::Isometry3d& T_camera_object) {
    constexpr float kFar = 1e9F;
    constexpr double kNear_m = 0.01;
    PlaneBounds bounds{kFar, -kFar, kFar, -kFar};
    for (std::size_t i = 0; i < surface.num_corners; ++i) {
      const Eigen::Vector2d corner = surface.corners[i].cast<double>();
      const Vector3d p = T_camera_object * (surface.origin + corner.x() * surface.axis_u +
                                            corner.y() * surface.axis_v);
      if (p.z() < kNear_m) return {-kFar, kFar, -kFar, kFar};
      const auto x = static_cast<float>(p.x() / p.z());
      const auto y = static_cast<float>(p.y() / p.z());
      bounds = {std::min(bounds.x_low, x), std::max(bounds.x_high, x), std::min(bounds.y_low, y),
                std::max(bounds.y_high, y)};
    }
    return bounds;
  }

  float lightOn(const Material& material, double cosine) const {
    if (material.shines) return 1.0F;
    const Lighting& lighting = scene_.lighting;
    // Leaves have no common normal.
    const double facing =
        material.pattern == Pattern::kLeaves ? 0.35 + 0.15 * cosine : std::max(0.0, cosine);
    return static_cast<float>(lighting.ambient + lighting.direct * facing);
  }

  const Scene& scene_;
  Eigen::Isometry3d T_camera_world_;
  PlaneBounds image_;
  VisibleSurfaces visible_;
};

}  // namespace

VisibleSurfaces findVisibleSurfaces(const Scene& scene, const std::vector<Instance>& movers,
                                    const Eigen::Isometry3d& T_world_camera,
                                    const PlaneBounds& image) {
  Finder finder(scene, T_world_camera, image);
  for (const Instance& instance : scene.instances) finder.add(instance);
  for (const Instance& mover : movers) finder.add(mover);
  return finder.take();
}

}  // namespace point_line_odometry::world
