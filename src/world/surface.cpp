#include "world/surface.h"

#include <algorithm>
#include <cmath>

#include "world/random.h"

namespace point_line_odometry::world {

using Eigen::Vector3d;

void ObjectBuilder::addPolygon(const std::vector<Vector3d>& corners, const Material& material,
                               const Eigen::Vector2d& texture) {
  Surface surface;
  surface.origin = corners.front();
  surface.axis_u = (corners[1] - corners[0]).normalized();
  const Vector3d normal = surface.axis_u.cross(corners.back() - corners[0]).normalized();
  surface.axis_v = normal.cross(surface.axis_u);
  surface.origin -= texture.x() * surface.axis_u + texture.y() * surface.axis_v;
  surface.num_corners = std::min(corners.size(), Surface::kMaxCorners);
  for (std::size_t i = 0; i < surface.num_corners; ++i) {
    const Vector3d offset = corners[i] - surface.origin;
    surface.corners[i] = {static_cast<float>(offset.dot(surface.axis_u)),
                          static_cast<float>(offset.dot(surface.axis_v))};
  }
  surface.material = material;
  object_.surfaces.push_back(surface);
}

void ObjectBuilder::addRectangle(const Vector3d& corner, const Vector3d& edge_u,
                                 const Vector3d& edge_v, const Material& material) {
  addPolygon({corner, corner + edge_u, corner + edge_u + edge_v, corner + edge_v}, material);
}

void ObjectBuilder::addBox(const BoxShape& box, const Material& sides, const Material& top) {
  addTaperedBox(box, Eigen::Vector2d::Zero(), sides, top);
}

void ObjectBuilder::addTaperedBox(const BoxShape& box, const Eigen::Vector2d& taper,
                                  const Material& sides, const Material& top) {
  std::array<Vector3d, 4> low;
  std::array<Vector3d, 4> high;
  for (int i = 0; i < 4; ++i) {
    const double x = (i == 0 || i == 3) ? -0.5 : 0.5;
    const double y = i < 2 ? -0.5 : 0.5;
    low[i] = box.T_world_box * Vector3d(x * box.size.x(), y * box.size.y(), 0.0);
    high[i] = box.T_world_box * Vector3d(x * (box.size.x() - 2.0 * taper.x()),
                                         y * (box.size.y() - 2.0 * taper.y()), box.size.z());
  }
  for (int i = 0; i < 4; ++i) {
    const int next = (i + 1) % 4;
    Material side = sides;
    side.seed += static_cast<std::uint32_t>(i);
    addPolygon({low[i], low[next], high[next], high[i]}, side);
  }
  addPolygon({high[0], high[1], high[2], high[3]}, top);
  addPolygon({low[3], low[2], low[1], low[0]}, sides);
}

void ObjectBuilder::addColumn(const Vector3d& foot, double height_m, double radius_low_m,
                              double radius_high_m, const Material& material) {
  constexpr int kSides = 6;
  const auto corner = [&](int i, double height, double radius) -> Vector3d {
    const double angle = 2.0 * kPi * i / kSides;
    return foot + Vector3d(radius * std::cos(angle), radius * std::sin(angle), height);
  };
  for (int i = 0; i < kSides; ++i) {
    Material side = material;
    side.seed += static_cast<std::uint32_t>(i);
    addPolygon({corner(i, 0.0, radius_low_m), corner(i + 1, 0.0, radius_low_m),
                corner(i + 1, height_m, radius_high_m), corner(i, height_m, radius_high_m)},
               side);
  }
}

Object ObjectBuilder::take(double visible_m) {
  Vector3d low = Vector3d::Constant(1e9);
  Vector3d high = Vector3d::Constant(-1e9);
  const auto corner = [](const Surface& s, std::size_t i) -> Vector3d {
    return s.origin + static_cast<double>(s.corners[i].x()) * s.axis_u +
           static_cast<double>(s.corners[i].y()) * s.axis_v;
  };
  for (const Surface& surface : object_.surfaces) {
    for (std::size_t i = 0; i < surface.num_corners; ++i) {
      low = low.cwiseMin(corner(surface, i));
      high = high.cwiseMax(corner(surface, i));
    }
  }
  object_.centre = 0.5 * (low + high);
  object_.radius_m = 0.5 * (high - low).norm();
  object_.visible_m = visible_m;
  Object taken;
  std::swap(taken, object_);
  return taken;
}

Eigen::Isometry3d uprightPose(const Vector3d& position, double yaw_rad) {
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
  pose.linear() = Eigen::AngleAxisd(yaw_rad, Vector3d::UnitZ()).toRotationMatrix();
  pose.translation() = position;
  return pose;
}

}  // namespace point_line_odometry::world
