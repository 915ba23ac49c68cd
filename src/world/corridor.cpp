#include "world/corridor.h"

#include "world/interior.h"

namespace point_line_odometry::world {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

constexpr double kWidth_m = 2.2;

/// A corridor around a rectangle of closed rooms.
class Ring {
 public:
  Ring(std::uint32_t seed, Scene* scene) : random_(seed), builder_(&random_, scene) {
    size_ = Vector2d{random_.uniform(20.0, 26.0), random_.uniform(12.0, 16.0)};
    interior_.wall = plain(random_.uniform(0.55, 0.75));
    interior_.floor = plain(random_.uniform(0.3, 0.4));
    interior_.ceiling = plain(0.8);
    interior_.trim = plain(random_.uniform(0.15, 0.3));
    interior_.door = plain(random_.uniform(0.3, 0.5));
    addFloors();
    addOuterWalls();
    addInnerWalls();
    addLamps();
  }

  std::vector<Vector3d> flight() const {
    constexpr double kHeight = 1.4;
    const double middle = 0.5 * kWidth_m;
    return {{middle, middle, kHeight},
            {size_.x() - middle, middle, kHeight},
            {size_.x() - middle, size_.y() - middle, kHeight},
            {middle, size_.y() - middle, kHeight}};
  }

 private:
  Material plain(double albedo) { return makeMaterial(Pattern::kPlain, albedo, 0.03, &random_); }

  /// Walls around a rectangle, seen from inside if the corners are counter-clockwise.
  static std::vector<WallSide> wallsAlong(const std::vector<Vector2d>& corners) {
    std::vector<WallSide> sides;
    for (std::size_t i = 0; i < corners.size(); ++i) {
      sides.push_back({corners[i], corners[(i + 1) % corners.size()], {}});
    }
    return sides;
  }

  void addFloors() {
    const double x = size_.x();
    const double y = size_.y();
    builder_.addFloor({0.0, 0.0}, {x, kWidth_m}, interior_);
    builder_.addFloor({0.0, y - kWidth_m}, {x, y}, interior_);
    builder_.addFloor({0.0, kWidth_m}, {kWidth_m, y - kWidth_m}, interior_);
    builder_.addFloor({x - kWidth_m, kWidth_m}, {x, y - kWidth_m}, interior_);
  }

  /// With doors, a handrail between them and a pipe under the ceiling.
  void addOuterWalls() {
    const Material rail = plain(0.2);
    const Material pipe = plain(0.45);
    for (const WallSide& side :
         wallsAlong({{0.0, 0.0}, {size_.x(), 0.0}, size_, {0.0, size_.y()}})) {
      builder_.addWall(side, interior_);
      builder_.addAtWall(side, {0.5 * side.length(), 2.45}, {side.length(), 0.12, 0.12}, pipe);
      constexpr double kClear = 0.5 * kDoorWidth_m + 0.15;
      double begin = 0.2;
      for (double x = 2.0; x < side.length() - 1.5; x += random_.uniform(3.0, 4.5)) {
        builder_.addDoor(side, x, interior_);
        const double end = x - kClear;
        builder_.addAtWall(side, {0.5 * (begin + end), 0.95}, {end - begin, 0.06, 0.05}, rail);
        begin = x + kClear;
      }
    }
  }

  /// With doors and pilasters.
  void addInnerWalls() {
    const Vector2d low = Vector2d::Constant(kWidth_m);
    const Vector2d high = size_ - low;
    for (const WallSide& side : wallsAlong({low, {low.x(), high.y()}, high, {high.x(), low.y()}})) {
      builder_.addWall(side, interior_);
      for (double x = 1.5; x < side.length() - 1.0; x += random_.uniform(2.5, 4.0)) {
        if (random_.chance(0.6)) {
          builder_.addDoor(side, x, interior_);
        } else {
          builder_.addAtWall(side, {x, 0.0}, {0.35, 0.16, kCeiling_m}, interior_.trim);
        }
      }
    }
  }

  void addLamps() {
    constexpr double kEvery = 2.6;
    const double middle = 0.5 * kWidth_m;
    for (double x = middle; x < size_.x(); x += kEvery) {
      builder_.addLamp({x, middle}, {1.2, 0.3});
      builder_.addLamp({x, size_.y() - middle}, {1.2, 0.3});
    }
    for (double y = kWidth_m + 1.2; y < size_.y() - kWidth_m - 0.8; y += kEvery) {
      builder_.addLamp({middle, y}, {0.3, 1.2});
      builder_.addLamp({size_.x() - middle, y}, {0.3, 1.2});
    }
  }

  Random random_;
  InteriorBuilder builder_;
  Interior interior_;
  Vector2d size_;
};

}  // namespace

Scene makeCorridor(std::uint32_t seed) { return makeFlight<Ring>(seed, 2); }

}  // namespace point_line_odometry::world
