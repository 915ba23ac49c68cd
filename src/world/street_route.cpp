#include "world/street_route.h"

#include <algorithm>

namespace point_line_odometry::world {

using Eigen::Vector2d;
using Eigen::Vector3d;

std::vector<Vector2d> chooseCrossings(Random* random) {
  const double a = random->integer(2, 3);
  const double b = a + random->integer(2, 3);
  const double c = random->integer(1, 2);
  const double h = random->integer(3, 4);
  std::vector<Vector2d> crossings = {{0, 0}, {a, 0}, {a, 1},     {b, 1},
                                     {b, h}, {c, h}, {c, h - 1}, {0, h - 1}};
  if (random->chance(0.5)) std::reverse(crossings.begin() + 1, crossings.end());
  return crossings;
}

std::vector<Vector2d> chooseCrossingsFromOutside(double outside, Random* random) {
  std::vector<Vector2d> crossings = chooseCrossings(random);
  // The drive begins at a corner and goes on along x, not along y.
  if (crossings[1].y() > 0.0) std::reverse(crossings.begin() + 1, crossings.end());
  for (Vector2d& crossing : crossings) {
    if (crossing.x() == 0.0) crossing.x() = -outside;
  }
  return crossings;
}

std::vector<Vector3d> toTheRight(const std::vector<Vector2d>& corners, double offset,
                                 double height) {
  std::vector<Vector3d> moved;
  const std::size_t n = corners.size();
  for (std::size_t i = 0; i < n; ++i) {
    const Vector2d in = (corners[i] - corners[(i + n - 1) % n]).normalized();
    const Vector2d out = (corners[(i + 1) % n] - corners[i]).normalized();
    const Vector2d right_in(in.y(), -in.x());
    const Vector2d right_out(out.y(), -out.x());
    const Vector2d corner = corners[i] + offset * (right_in + right_out);
    moved.emplace_back(corner.x(), corner.y(), height);
  }
  return moved;
}

std::vector<Vector3d> overTheHill(const std::vector<Vector3d>& corners, const Hill& hill) {
  constexpr double kStep_m = 5.0;
  std::vector<Vector3d> bent = {corners.front()};
  const Vector3d& begin = corners.front();
  for (double s = -hill.half_length_m; s <= hill.half_length_m; s += kStep_m) {
    const double x = hill.middle_x + s;
    bent.emplace_back(x, begin.y(), begin.z() + hill.heightAt(x));
  }
  bent.insert(bent.end(), corners.begin() + 1, corners.end());
  return bent;
}

}  // namespace point_line_odometry::world
