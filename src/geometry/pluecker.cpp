#include "geometry/pluecker.h"

#include <cmath>

namespace point_line_odometry {

PlueckerLine PlueckerLine::throughPoints(const Eigen::Vector4d& first,
                                         const Eigen::Vector4d& second) {
  PlueckerLine line;
  line.n = first.head<3>().cross(second.head<3>());
  line.v = first.w() * second.head<3>() - second.w() * first.head<3>();
  return line;
}

PlueckerLine PlueckerLine::throughPoints(const Eigen::Vector3d& first,
                                         const Eigen::Vector3d& second) {
  return throughPoints(Eigen::Vector4d(first.homogeneous()), Eigen::Vector4d(second.homogeneous()));
}

PlueckerLine PlueckerLine::transformed(const Eigen::Isometry3d& T_a_b) const {
  PlueckerLine line;
  line.v = T_a_b.linear() * v;
  line.n = T_a_b.linear() * n + T_a_b.translation().cross(line.v);
  return line;
}

Eigen::Matrix3d lineProjectionMatrix(const StereoCamera& camera) {
  Eigen::Matrix3d K_l;
  K_l << camera.fy, 0.0, 0.0,  //
      0.0, camera.fx, 0.0,     //
      -camera.fy * camera.cx, -camera.fx * camera.cy, camera.fx * camera.fy;
  return K_l;
}

double distanceToLine(const Eigen::Vector3d& line, const Eigen::Vector2d& pixel) {
  return line.dot(pixel.homogeneous()) / line.head<2>().norm();
}

}  // namespace point_line_odometry
