#include "world/indoor.h"

#include "world/interior.h"

namespace point_line_odometry::world {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

constexpr int kRooms = 4;
constexpr double kHallway_m = 2.6;
constexpr double kDepth_m = 5.6;                           // of a room
constexpr double kBack_m = kHallway_m + kWallThickness_m;  // y at which rooms begin
constexpr double kDoorsBetween_m = kBack_m + 0.5 * kDepth_m;

/// Rooms in a row along a hallway.
///
///     y  +------+------+------+------+
///        | room   room   room   room |      open doors between rooms, and from the first and the
///        +--  --+------+------+--  --+      last room to the hallway
///        |          hallway          |
///        +---------------------------+ x
class Apartment {
 public:
  Apartment(std::uint32_t seed, Scene* scene) : random_(seed), builder_(&random_, scene) {
    for (int i = 0; i < kRooms; ++i) {
      borders_.push_back(borders_.back() + random_.uniform(5.6, 7.2));
    }
    addHallway();
    for (std::size_t room = 0; room < kRooms; ++room) addRoom(room);
    addSills();
  }

  /// The trajectory: up the hallway and back through the rooms.
  std::vector<Vector3d> flight() const {
    constexpr double kHeight = 1.4;
    return {{firstDoor(), 0.5 * kHallway_m, kHeight},
            {lastDoor(), 0.5 * kHallway_m, kHeight + 0.15},
            {lastDoor(), kDoorsBetween_m, kHeight},
            {firstDoor(), kDoorsBetween_m, kHeight - 0.15}};
  }

 private:
  double length() const { return borders_.back(); }
  double firstDoor() const { return 0.5 * borders_[1]; }
  double lastDoor() const { return 0.5 * (borders_[kRooms - 1] + length()); }

  Interior chooseInterior(Pattern floor) {
    Interior interior;
    const double wall = random_.uniform(0.5, 0.75);
    const double roughness = random_.uniform(0.04, 0.09);
    interior.wall = makeMaterial(Pattern::kRough, wall, roughness, &random_);
    const Vector2d tile{random_.uniform(0.3, 1.4), random_.uniform(0.12, 0.5)};
    interior.floor = makeMaterial(floor, random_.uniform(0.25, 0.45), 0.3, tile, &random_);
    interior.ceiling = makeMaterial(Pattern::kTiles, 0.8, 0.06, {0.6, 0.6}, &random_);
    interior.trim = makeMaterial(Pattern::kPlain, random_.uniform(0.15, 0.85), 0.05, &random_);
    interior.door =
        makeMaterial(Pattern::kPanels, random_.uniform(0.2, 0.6), 0.15, {0.5, 0.7}, &random_);
    return interior;
  }

  void addHallway() {
    hall_ = chooseInterior(Pattern::kTiles);
    builder_.addFloor({0.0, 0.0}, {length(), kHallway_m}, hall_);
    const WallSide outer{{0.0, 0.0}, {length(), 0.0}, {}};
    const WallSide inner{
        {length(), kHallway_m}, {0.0, kHallway_m}, {length() - lastDoor(), length() - firstDoor()}};
    const WallSide far_end{{length(), 0.0}, {length(), kHallway_m}, {}};
    const WallSide near_end{{0.0, kHallway_m}, {0.0, 0.0}, {}};
    for (const WallSide& side : {outer, inner, far_end, near_end}) builder_.addWall(side, hall_);
    addPosters(far_end, {0.1, kHallway_m - 0.1});
    addPosters(near_end, {0.1, kHallway_m - 0.1});
    for (double x = 1.0; x < length() - 3.0; x += 4.2) {
      builder_.addDoor(outer, x + 0.6, hall_);
      addPosters(outer, {x + 1.4, x + 4.0});
      builder_.addLamp({x + 2.0, 0.5 * kHallway_m}, {1.2, 0.3});
    }
    for (std::size_t room = 1; room + 1 < kRooms; ++room) {
      const double middle = length() - 0.5 * (borders_[room] + borders_[room + 1]);
      builder_.addDoor(inner, middle, hall_);
      addPosters(inner, {middle + 0.8, middle + 2.6});
    }
  }

  void addRoom(std::size_t room) {
    const bool first = room == 0;
    const bool last = room + 1 == kRooms;
    const double left = borders_[room] + (first ? 0.0 : 0.5 * kWallThickness_m);
    const double right = borders_[room + 1] - (last ? 0.0 : 0.5 * kWallThickness_m);
    const double width = right - left;
    const double far = kBack_m + kDepth_m;
    WallSide front{{left, kBack_m}, {right, kBack_m}, {}};
    WallSide east{{right, kBack_m}, {right, far}, {}};
    const WallSide rear{{right, far}, {left, far}, {}};
    WallSide west{{left, far}, {left, kBack_m}, {}};
    if (first) front.doorways = {firstDoor() - left};
    if (last) front.doorways = {lastDoor() - left};
    if (!last) east.doorways = {0.5 * kDepth_m};
    if (!first) west.doorways = {0.5 * kDepth_m};

    const Interior interior =
        chooseInterior(random_.chance(0.5) ? Pattern::kTiles : Pattern::kRough);
    builder_.addFloor({left, kBack_m}, {right, far}, interior);
    for (const WallSide& side : {front, east, rear, west}) builder_.addWall(side, interior);
    addShelf(rear, 0.25 * width, random_.uniform(1.2, 0.45 * width));
    addPosters(rear, {0.52 * width, width - 0.2});
    addPosters(east, {0.2, 0.5 * kDepth_m - 0.8});
    addPosters(west, {0.5 * kDepth_m + 0.8, kDepth_m - 0.2});
    if (!first && !last) addShelf(front, 0.5 * width, 0.5 * width);
    addTable({left + random_.uniform(0.3, 0.7) * width, far - 1.3});
    addCrates({left + 0.8, kBack_m + 0.7});
    addCrates({right - 0.8, far - 0.6});
    builder_.addLamp({left + 0.5 * width, kDoorsBetween_m}, {1.2, 0.6});
  }

  /// The floor within the doorways.
  void addSills() {
    Interior sill = hall_;
    sill.floor = makeMaterial(Pattern::kPlain, 0.25, 0.1, &random_);
    const Vector2d across(0.5 * kWallThickness_m, 0.5 * kDoorWidth_m);
    for (std::size_t room = 1; room < kRooms; ++room) {
      const Vector2d middle(borders_[room], kDoorsBetween_m);
      builder_.addFloor(middle - across, middle + across, sill);
    }
    const Vector2d along(0.5 * kDoorWidth_m, 0.5 * kWallThickness_m);
    for (const double x : {firstDoor(), lastDoor()}) {
      const Vector2d middle(x, 0.5 * (kHallway_m + kBack_m));
      builder_.addFloor(middle - along, middle + along, sill);
    }
  }

  /// Posters on a stretch of a wall.
  void addPosters(const WallSide& side, const Vector2d& range) {
    double x = range.x() + random_.uniform(0.2, 0.6);
    while (x < range.y() - 0.6) {
      const Vector2d size{random_.uniform(0.4, 1.1), random_.uniform(0.4, 1.0)};
      if (x + size.x() > range.y()) break;
      const Material picture = makeMaterial(Pattern::kPicture, 0.5, 0.7, size, &random_);
      builder_.addAtWall(side, {x + 0.5 * size.x(), random_.uniform(1.1, 1.5)},
                         {size.x(), 0.02, size.y()}, picture);
      x += size.x() + random_.uniform(0.15, 0.9);
    }
  }

  void addShelf(const WallSide& side, double middle, double width) {
    const Material books = makeMaterial(Pattern::kShelf, 0.9, 0.5, {0.13, 0.34}, &random_);
    const Material wood = makeMaterial(Pattern::kRough, 0.35, 0.2, &random_);
    builder_.addAtWall(side, {middle, 0.0}, {width, random_.uniform(0.25, 0.4), 2.06}, books, wood);
  }

  /// A table with things on it.
  void addTable(const Vector2d& middle) {
    const double yaw = random_.uniform(-0.4, 0.4);
    const Eigen::Isometry3d T = uprightPose({middle.x(), middle.y(), 0.0}, yaw);
    const Vector2d size{random_.uniform(1.1, 1.7), random_.uniform(0.6, 0.9)};
    const Material wood = makeMaterial(Pattern::kRough, random_.uniform(0.3, 0.6), 0.2, &random_);
    constexpr double kTableHeight = 0.72;
    for (const double x : {-0.45, 0.45}) {
      for (const double y : {-0.45, 0.45}) {
        const Vector3d foot(x * size.x(), y * size.y(), 0.0);
        builder_.addBox({T * uprightPose(foot, 0.0), {0.05, 0.05, kTableHeight}}, wood, wood);
      }
    }
    builder_.addBox({T * uprightPose({0.0, 0.0, kTableHeight}, 0.0), {size.x(), size.y(), 0.04}},
                    wood, wood);
    for (int i = 0; i < 3; ++i) {
      const Vector3d spot{random_.uniform(-0.4, 0.4) * size.x(),
                          random_.uniform(-0.3, 0.3) * size.y(), kTableHeight + 0.04};
      const Vector3d box{random_.uniform(0.15, 0.4), random_.uniform(0.1, 0.25),
                         random_.uniform(0.1, 0.35)};
      const Material label = makeMaterial(Pattern::kPicture, 0.5, 0.7, {0.4, 0.3}, &random_);
      builder_.addBox({T * uprightPose(spot, random_.uniform(0.0, kPi)), box}, label, label);
    }
  }

  /// A stack of boxes.
  void addCrates(const Vector2d& middle) {
    double foot = 0.0;
    for (int i = random_.integer(1, 3); i > 0; --i) {
      const double size = random_.uniform(0.35, 0.6);
      const Material crate = makeMaterial(Pattern::kPicture, 0.4, 0.5, {size, size}, &random_);
      const Vector3d position(middle.x(), middle.y(), foot);
      builder_.addBox({uprightPose(position, random_.uniform(0.0, kPi)), Vector3d::Constant(size)},
                      crate, crate);
      foot += size;
    }
  }

  Random random_;
  InteriorBuilder builder_;
  Interior hall_;
  std::vector<double> borders_ = {0.0};  // between rooms, along x
};

}  // namespace

Scene makeIndoor(std::uint32_t seed) { return makeFlight<Apartment>(seed, 1); }

}  // namespace point_line_odometry::world
