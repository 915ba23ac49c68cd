#include "world/plaster.h"

#include <algorithm>

#include "world/interior.h"

namespace point_line_odometry::world {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

constexpr int kColumns = 6;  // even, so that the path ends in the passage
constexpr int kRows = 3;
constexpr double kPassage_m = 2.4;

/// An open door, and the direction in which it is flown through.
struct Doorway {
  Vector2d middle;
  Vector2d direction;
};

/// A passage, and rooms that are flown through column by column.
///
///     y  +----+----+----+----+----+----+
///        | .----. | .----. | .----.   |      doors where the path (.) crosses a wall, somewhere
///        +-|--+-|-+-|--+-|-+-|--+-|---+      along it
///        | |  | |   |  | |   |  | |   |
///        +-|--+-|-+-|--+-|-+-|--+-|---+
///        | |  | '----' | '----' | |   |
///        +-|--+---+----+---+----+-|---+
///        | '------ passage -------'   |
///        +----------------------------+ x
class Vaults {
 public:
  Vaults(std::uint32_t seed, Scene* scene) : random_(seed), builder_(&random_, scene) {
    for (int i = 0; i < kColumns; ++i) x_.push_back(x_.back() + random_.uniform(4.3, 5.6));
    for (int i = 0; i < kRows; ++i) y_.push_back(y_.back() + random_.uniform(4.1, 5.1));
    addDoorways();
    addSpace({x_.front(), 0.0}, {x_.back(), kPassage_m});
    for (std::size_t i = 0; i < kColumns; ++i) {
      for (std::size_t j = 0; j < kRows; ++j) addSpace({x_[i], y_[j]}, {x_[i + 1], y_[j + 1]});
    }
    addSills();
  }

  /// The trajectory: along the passage and back through all rooms, straight through every door.
  std::vector<Vector3d> flight() const {
    constexpr double kStraight_m = 0.55;
    std::vector<Vector3d> corners;
    const auto add = [&](const Vector2d& position, double height) {
      corners.emplace_back(position.x(), position.y(), height);
    };
    constexpr double kHeight = 1.4;
    add({doorways_.back().middle.x(), 0.5 * kPassage_m}, kHeight);
    add({doorways_.front().middle.x(), 0.5 * kPassage_m}, kHeight);
    for (std::size_t i = 0; i < doorways_.size(); ++i) {
      const Doorway& door = doorways_[i];
      const double height = kHeight + (i % 2 == 0 ? 0.12 : -0.12);
      add(door.middle - kStraight_m * door.direction, height);
      add(door.middle + kStraight_m * door.direction, height);
    }
    return corners;
  }

 private:
  /// A position in the wall between two points, far enough from its ends for a door.
  Vector2d doorPosition(const Vector2d& from, const Vector2d& to) {
    constexpr double kFromEnd_m = 1.0;
    const double length = (to - from).norm();
    return from + (to - from) * (random_.uniform(kFromEnd_m, length - kFromEnd_m) / length);
  }

  /// From the passage up the last column, down the one before it and so on, in this order.
  void addDoorways() {
    for (std::size_t i = kColumns; i-- > 0;) {
      const bool up = i % 2 == 1;
      const Vector2d along(0.0, up ? 1.0 : -1.0);
      for (std::size_t step = 0; step < kRows; ++step) {
        const std::size_t row = up ? step : kRows - 1 - step;  // row whose lower wall is crossed
        const bool outside = row == 0 && i != 0 && i + 1 != kColumns;
        if (outside) continue;
        doorways_.push_back({doorPosition({x_[i], y_[row]}, {x_[i + 1], y_[row]}), along});
      }
      if (i == 0) break;
      const std::size_t row =
          up ? kRows - 1 : 0;  // row in which the path changes to the next column
      doorways_.push_back({doorPosition({x_[i], y_[row]}, {x_[i], y_[row + 1]}), {-1.0, 0.0}});
    }
  }

  Material spots(double albedo, double contrast) {
    return makeMaterial(Pattern::kSpots, albedo, contrast, &random_);
  }

  Interior chooseInterior() {
    Interior interior;
    const double wall = random_.uniform(0.42, 0.58);
    interior.wall = spots(wall, random_.uniform(0.10, 0.13));
    // Compilers differ in the order of a call's arguments.
    const double floor_contrast = random_.uniform(0.12, 0.16);
    interior.floor = spots(random_.uniform(0.32, 0.45), floor_contrast);
    const double ceiling_contrast = random_.uniform(0.09, 0.12);
    interior.ceiling = spots(random_.uniform(0.45, 0.6), ceiling_contrast);
    interior.trim = spots(wall * random_.uniform(0.62, 0.8), 0.06);
    interior.door = spots(wall * random_.uniform(0.7, 0.9), 0.06);
    return interior;
  }

  /// A room, or the passage, between the middles of its walls.
  void addSpace(const Vector2d& from, const Vector2d& to) {
    const Vector2d half_wall = Vector2d::Constant(0.5 * kWallThickness_m);
    const Vector2d low = from + half_wall;
    const Vector2d high = to - half_wall;
    const Interior interior = chooseInterior();
    builder_.addFloor(low, high, interior);
    const Vector2d right(high.x(), low.y());
    const Vector2d left(low.x(), high.y());
    std::vector<WallSide> sides = {
        {low, right, {}}, {right, high, {}}, {high, left, {}}, {left, low, {}}};
    for (WallSide& side : sides) {
      side.doorways = doorwaysIn(side);
      builder_.addWall(side, interior);
      if (side.doorways.empty()) addRelief(side, interior);
    }
    for (double x = low.x() + random_.uniform(0.8, 2.0); x < high.x() - 0.5;
         x += random_.uniform(2.2, 3.5)) {
      builder_.addBeam({x, low.y()}, {x, high.y()}, 0.2, interior.trim);
    }
  }

  std::vector<double> doorwaysIn(const WallSide& side) const {
    const Eigen::Isometry3d T_side_world = side.pose().inverse();
    std::vector<double> middles;
    for (const Doorway& door : doorways_) {
      const Vector3d position = T_side_world * Vector3d(door.middle.x(), door.middle.y(), 0.0);
      const bool in_wall = position.y() < 0.0 && position.y() > -kWallThickness_m;
      if (in_wall && position.x() > 0.0 && position.x() < side.length())
        middles.push_back(position.x());
    }
    std::sort(middles.begin(), middles.end());
    return middles;
  }

  /// Adds closed doors or pilasters to a wall without open doors.
  void addRelief(const WallSide& side, const Interior& interior) {
    for (double x = random_.uniform(0.9, 2.5); x < side.length() - 0.9;
         x += random_.uniform(3.0, 6.0)) {
      if (random_.chance(0.3)) {
        builder_.addDoor(side, x, interior);
      } else {
        builder_.addAtWall(side, {x, 0.0}, {0.35, 0.12, kCeiling_m}, interior.trim);
      }
    }
  }

  /// The floor within the doorways.
  void addSills() {
    Interior sill;
    sill.floor = spots(0.3, 0.06);
    sill.ceiling = sill.floor;
    for (const Doorway& door : doorways_) {
      const Vector2d across(-door.direction.y(), door.direction.x());
      const Vector2d half = (0.5 * kWallThickness_m * door.direction.cwiseAbs() +
                             0.5 * kDoorWidth_m * across.cwiseAbs());
      builder_.addFloor(door.middle - half, door.middle + half, sill);
    }
  }

  Random random_;
  InteriorBuilder builder_;
  std::vector<double> x_ = {0.0};         // between columns
  std::vector<double> y_ = {kPassage_m};  // between rows
  std::vector<Doorway> doorways_;         // in the order of the flight
};

/// A fast drone with a strongly swaying camera.
MotionStyle hurriedStyle() {
  MotionStyle style;
  style.cruise_m_s = 2.0;
  style.lateral_m_s2 = 3.5;
  style.longitudinal_m_s2 = 2.5;
  style.turn_rad_s = 80.0 * kPi / 180.0;
  style.sway_m = {0.03, 0.05, 0.08};
  style.sway_rad = Vector3d(5.0, 4.0, 6.0) * kPi / 180.0;
  style.sway_hz = 0.35;
  return style;
}

}  // namespace

Scene makePlaster(std::uint32_t seed) {
  Scene scene = makeFlight<Vaults>(seed, 3, hurriedStyle());
  scene.lighting.ambient = 0.46;
  scene.lighting.direct = 0.24;
  constexpr double kShutter_ms = 15.0;
  constexpr double kNoise = 8.0;  // 5 to 8 grey levels from the darkest to the lightest wall
  constexpr int kInstants = 6;    // the steps between more would be hidden in the noise
  scene.exposure = {kShutter_ms, kInstants, kNoise};
  return scene;
}

}  // namespace point_line_odometry::world
