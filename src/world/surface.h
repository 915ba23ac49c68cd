#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <array>
#include <cstddef>
#include <vector>

#include "world/material.h"

namespace point_line_odometry::world {

/// A flat convex polygon of up to eight corners that is seen from one side.
///
/// World frame: x and y level, z up [m].
struct Surface {
  static constexpr std::size_t kMaxCorners = 8;

  Eigen::Vector3d origin;  ///< where (u, v) is (0, 0)
  Eigen::Vector3d axis_u;  ///< unit vectors; u x v points to the side from which it is seen
  Eigen::Vector3d axis_v;
  std::array<Eigen::Vector2f, kMaxCorners> corners;  ///< (u, v) [m], counter-clockwise
  std::size_t num_corners = 0;
  Material material;
};

/// A group of surfaces with its bounding sphere.
struct Object {
  std::vector<Surface> surfaces;
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();
  double radius_m = 0.0;
  double visible_m = 1e9;  ///< not drawn from farther away
};

/// Size of a box along its own axes [m], and the pose of the middle of its bottom.
struct BoxShape {
  Eigen::Isometry3d T_world_box = Eigen::Isometry3d::Identity();
  Eigen::Vector3d size = Eigen::Vector3d::Ones();
};

/// Collects the surfaces of an object.
class ObjectBuilder {
 public:
  /// A polygon in the order in which its corners are seen counter-clockwise; u runs along the
  /// first edge.
  /// \param texture (u, v) of the first corner [m]: neighbours may share a pattern.
  void addPolygon(const std::vector<Eigen::Vector3d>& corners, const Material& material,
                  const Eigen::Vector2d& texture = Eigen::Vector2d::Zero());

  /// A rectangle from a corner along two perpendicular edges.
  void addRectangle(const Eigen::Vector3d& corner, const Eigen::Vector3d& edge_u,
                    const Eigen::Vector3d& edge_v, const Material& material);

  /// The six faces of a box; the bottom has the material of the sides.
  void addBox(const BoxShape& box, const Material& sides, const Material& top);
  void addBox(const BoxShape& box, const Material& all) { addBox(box, all, all); }

  /// A box whose top is shorter at each end by `taper` [m] along x and y.
  void addTaperedBox(const BoxShape& box, const Eigen::Vector2d& taper, const Material& sides,
                     const Material& top);

  /// An upright prism of six sides, or a cone's part if the radii differ.
  void addColumn(const Eigen::Vector3d& foot, double height_m, double radius_low_m,
                 double radius_high_m, const Material& material);

  /// Returns the object with its bounding sphere, and empties the builder.
  Object take(double visible_m = 1e9);

 private:
  Object object_;
};

/// Pose with a rotation about the vertical.
Eigen::Isometry3d uprightPose(const Eigen::Vector3d& position, double yaw_rad);

}  // namespace point_line_odometry::world
