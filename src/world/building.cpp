#include <cmath>

#include "world/random.h"
#include "world/scene.h"

namespace point_line_odometry::world {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

constexpr double kPi = 3.14159265358979323846;

// Measures in metres.
constexpr double kCeiling = 2.8;
constexpr double kDoorWidth = 1.1;
constexpr double kDoorHeight = 2.1;
constexpr double kWallThickness = 0.2;

Material make(Pattern pattern, double albedo, double contrast, Random* random) {
  Material material;
  material.pattern = pattern;
  material.albedo = static_cast<float>(albedo);
  material.contrast = static_cast<float>(contrast);
  material.seed = random->bits();
  return material;
}

Material makeGrid(Pattern pattern, double albedo, double contrast, const Vector2d& size,
                  Random* random) {
  Material material = make(pattern, albedo, contrast, random);
  material.size_u = static_cast<float>(size.x());
  material.size_v = static_cast<float>(size.y());
  return material;
}

/// One side of a wall: from a corner along its foot; seen from the left of that direction.
struct WallSide {
  Vector2d from;
  Vector2d to;
  std::vector<double> doorways;  ///< middles of open doors, from `from` [m]

  double length() const { return (to - from).norm(); }

  /// x along the foot, y out of the wall into the room, z up.
  Eigen::Isometry3d pose() const {
    const Vector2d along = to - from;
    Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
    T.linear() =
        Eigen::AngleAxisd(std::atan2(along.y(), along.x()), Vector3d::UnitZ()).toRotationMatrix();
    T.translation() << from.x(), from.y(), 0.0;
    return T;
  }
};

/// How the inside of a building looks.
struct Interior {
  Material wall;
  Material floor;
  Material ceiling;
  Material trim;  ///< skirting boards and door frames
  Material door;
};

/// Builds rooms into a scene. Whatever is added to a wall is given in the frame of its side.
class Builder {
 public:
  Builder(Random* random, Scene* scene) : random_(*random), scene_(*scene) {}

  void place(Object object) {
    scene_.objects.push_back(std::move(object));
    scene_.instances.push_back({scene_.objects.size() - 1, Eigen::Isometry3d::Identity()});
  }

  /// Floor and ceiling of a rectangle.
  void addFloor(const Vector2d& low, const Vector2d& high, const Interior& interior) {
    ObjectBuilder builder;
    const Vector3d x(high.x() - low.x(), 0.0, 0.0);
    const Vector3d y(0.0, high.y() - low.y(), 0.0);
    builder.addRectangle({low.x(), low.y(), 0.0}, x, y, interior.floor);
    builder.addRectangle({low.x(), high.y(), kCeiling}, x, -y, interior.ceiling);
    place(builder.take());
  }

  /// A wall with its openings, their frames, and skirting boards.
  void addWall(const WallSide& side, const Interior& interior) {
    ObjectBuilder builder;
    Material wall = interior.wall;
    wall.seed = random_.bits();
    double begin = 0.0;
    for (const double doorway : side.doorways) {
      addWallPiece(side, {begin, doorway - 0.5 * kDoorWidth}, {wall, interior.trim}, &builder);
      addOpening(side, doorway, {wall, interior.trim}, &builder);
      begin = doorway + 0.5 * kDoorWidth;
    }
    addWallPiece(side, {begin, side.length()}, {wall, interior.trim}, &builder);
    place(builder.take());
  }

  /// A box that stands against a wall: middle of its foot along the wall, height of the foot, and
  /// size along the wall, out of it and up.
  void addAtWall(const WallSide& side, const Vector2d& foot, const Vector3d& size,
                 const Material& material) {
    addAtWall(side, foot, size, material, material);
  }
  void addAtWall(const WallSide& side, const Vector2d& foot, const Vector3d& size,
                 const Material& front, const Material& top) {
    ObjectBuilder builder;
    const Vector3d place_in_side(foot.x(), 0.5 * size.y(), foot.y());
    builder.addBox({side.pose() * uprightPose(place_in_side, 0.0), size}, front, top);
    place(builder.take());
  }

  /// A closed door with its frame.
  void addDoor(const WallSide& side, double middle, const Interior& interior) {
    Material door = interior.door;
    door.seed = random_.bits();
    addAtWall(side, {middle, 0.0}, {kDoorWidth - 0.1, 0.03, kDoorHeight - 0.05}, door);
    constexpr double kFrame = 0.09;
    for (const double end : {-0.5, 0.5}) {
      addAtWall(side, {middle + end * kDoorWidth, 0.0}, {kFrame, 0.06, kDoorHeight}, interior.trim);
    }
    addAtWall(side, {middle, kDoorHeight - 0.02}, {kDoorWidth + kFrame, 0.06, kFrame},
              interior.trim);
    addAtWall(side, {middle + 0.38 * kDoorWidth, 1.02}, {0.13, 0.09, 0.03},
              make(Pattern::kPlain, 0.3, 0.1, &random_));
  }

  /// A lamp in the ceiling, seen from below.
  void addLamp(const Vector2d& middle, const Vector2d& size) {
    ObjectBuilder builder;
    Material shine = make(Pattern::kPlain, 0.97, 0.0, &random_);
    shine.shines = true;
    const double z = kCeiling - 0.05;
    const Vector3d corner(middle.x() - 0.5 * size.x(), middle.y() + 0.5 * size.y(), z);
    const Vector3d x(size.x(), 0.0, 0.0);
    const Vector3d y(0.0, size.y(), 0.0);
    const Vector3d up(0.0, 0.0, 0.05);
    builder.addRectangle(corner, x, -y, shine);
    const Material edge = make(Pattern::kPlain, 0.4, 0.05, &random_);
    builder.addRectangle(corner - y, x, up, edge);
    builder.addRectangle(corner - y + x, y, up, edge);
    builder.addRectangle(corner + x, -x, up, edge);
    builder.addRectangle(corner, -y, up, edge);
    place(builder.take());
  }

  /// A box on the floor, or at a height.
  void addBox(const Vector3d& foot, double yaw, const Vector3d& size, const Material& sides,
              const Material& top) {
    ObjectBuilder builder;
    builder.addBox({uprightPose(foot, yaw), size}, sides, top);
    place(builder.take());
  }

 private:
  struct Finish {
    Material wall;
    Material trim;
  };

  static void addWallPiece(const WallSide& side, const Vector2d& range, const Finish& finish,
                           ObjectBuilder* builder) {
    const double length = range.y() - range.x();
    if (length < 1e-6) return;
    const Eigen::Isometry3d T = side.pose();
    addFace(T, {range.y(), 0.0, 0.0}, {-length, 0.0, kCeiling}, finish.wall, builder);
    builder->addBox(
        {T * uprightPose({range.x() + 0.5 * length, 0.01, 0.0}, 0.0), {length, 0.02, 0.11}},
        finish.trim);
  }

  /// A rectangle that is seen from the room, y > 0 (edges: along x and up).
  static void addFace(const Eigen::Isometry3d& T, const Vector3d& corner, const Vector3d& edges,
                      const Material& material, ObjectBuilder* builder) {
    builder->addRectangle(T * corner, T.linear() * Vector3d(edges.x(), 0.0, 0.0),
                          Vector3d(0.0, 0.0, edges.z()), material);
  }

  /// The wall over an open door, the sides of the opening and the frame.
  static void addOpening(const WallSide& side, double middle, const Finish& finish,
                         ObjectBuilder* builder) {
    const Eigen::Isometry3d T = side.pose();
    const double half = 0.5 * kDoorWidth;
    addFace(T, {middle + half, 0.0, kDoorHeight}, {-kDoorWidth, 0.0, kCeiling - kDoorHeight},
            finish.wall, builder);
    const Vector3d deep = T.linear() * Vector3d(0.0, -0.5 * kWallThickness, 0.0);
    const Vector3d up(0.0, 0.0, kDoorHeight);
    const Vector3d across = T.linear() * Vector3d(kDoorWidth, 0.0, 0.0);
    const Vector3d left = T * Vector3d(middle - half, 0.0, 0.0);
    builder->addRectangle(left + deep, -deep, up, finish.trim);
    builder->addRectangle(left + across, deep, up, finish.trim);
    builder->addRectangle(left + up, across, deep, finish.trim);
    constexpr double kFrame = 0.09;
    for (const double end : {-1.0, 1.0}) {
      const Vector3d foot(middle + end * (half + 0.5 * kFrame), 0.02, 0.0);
      builder->addBox({T * uprightPose(foot, 0.0), {kFrame, 0.04, kDoorHeight + kFrame}},
                      finish.trim);
    }
    builder->addBox({T * uprightPose({middle, 0.02, kDoorHeight}, 0.0), {kDoorWidth, 0.04, kFrame}},
                    finish.trim);
  }

  Random& random_;
  Scene& scene_;
};

MotionStyle flightStyle() {
  MotionStyle style;
  style.cruise_m_s = 1.0;
  style.lateral_m_s2 = 0.6;
  style.longitudinal_m_s2 = 0.5;
  style.sway_m = {0.03, 0.06, 0.08};
  style.sway_rad = Vector3d(4.0, 4.0, 5.0) * kPi / 180.0;
  style.sway_hz = 0.25;
  return style;
}

Lighting roomLighting() { return {Vector3d(0.35, -0.25, 0.9).normalized(), 0.72, 0.4}; }

/// Furniture, posters and windows of rooms.
class Furnisher {
 public:
  Furnisher(Random* random, Builder* builder) : random_(*random), builder_(*builder) {}

  void addPosters(const WallSide& side, const Vector2d& range) {
    for (double x = range.x() + random_.uniform(0.2, 0.6); x < range.y() - 0.6;) {
      const double width = random_.uniform(0.4, 1.1);
      const double height = random_.uniform(0.4, 1.0);
      if (x + width > range.y()) break;
      const Material picture = makeGrid(Pattern::kPicture, 0.5, 0.7, {width, height}, &random_);
      builder_.addAtWall(side, {x + 0.5 * width, random_.uniform(1.1, 1.5)}, {width, 0.02, height},
                         picture);
      x += width + random_.uniform(0.15, 0.9);
    }
  }

  void addShelf(const WallSide& side, double middle, double width) {
    const Material books = makeGrid(Pattern::kShelf, 0.9, 0.5, {0.13, 0.34}, &random_);
    const Material wood = make(Pattern::kRough, 0.35, 0.2, &random_);
    builder_.addAtWall(side, {middle, 0.0}, {width, random_.uniform(0.25, 0.4), 2.06}, books, wood);
  }

  void addTable(const Vector2d& middle) {
    const double yaw = random_.uniform(-0.4, 0.4);
    const Eigen::Isometry3d T = uprightPose({middle.x(), middle.y(), 0.0}, yaw);
    const Vector2d size(random_.uniform(1.1, 1.7), random_.uniform(0.6, 0.9));
    const Material wood = make(Pattern::kRough, random_.uniform(0.3, 0.6), 0.2, &random_);
    for (const double x : {-0.45, 0.45}) {
      for (const double y : {-0.45, 0.45}) {
        builder_.addBox(T * Vector3d(x * size.x(), y * size.y(), 0.0), yaw, {0.05, 0.05, 0.72},
                        wood, wood);
      }
    }
    builder_.addBox(T * Vector3d(0.0, 0.0, 0.72), yaw, {size.x(), size.y(), 0.04}, wood, wood);
    for (int i = 0; i < 3; ++i) {
      const Vector3d spot(random_.uniform(-0.4, 0.4) * size.x(),
                          random_.uniform(-0.3, 0.3) * size.y(), 0.76);
      const Vector3d box(random_.uniform(0.15, 0.4), random_.uniform(0.1, 0.25),
                         random_.uniform(0.1, 0.35));
      const Material label = makeGrid(Pattern::kPicture, 0.5, 0.7, {0.4, 0.3}, &random_);
      builder_.addBox(T * spot, random_.uniform(0.0, kPi), box, label, label);
    }
  }

  void addCrates(const Vector2d& middle) {
    double foot = 0.0;
    for (int i = random_.integer(1, 3); i > 0; --i) {
      const double size = random_.uniform(0.35, 0.6);
      const Material crate = makeGrid(Pattern::kPicture, 0.4, 0.5, {size, size}, &random_);
      builder_.addBox({middle.x(), middle.y(), foot}, random_.uniform(0.0, kPi),
                      Vector3d::Constant(size), crate, crate);
      foot += size;
    }
  }

 private:
  Random& random_;
  Builder& builder_;
};

}  // namespace

// Four rooms in a row along a hallway; the flight goes up the hallway and back through the rooms.
//
//   y  +------+------+------+------+
//      | room   room   room   room |      open doors between rooms, and from the first and the
//      +--  --+------+------+--  --+      last room to the hallway
//      |          hallway          |
//      +---------------------------+ x
Scene makeIndoor(std::uint32_t seed) {
  constexpr int kRooms = 4;
  constexpr double kHallway = 2.6;
  constexpr double kDepth = 5.6;
  Scene scene;
  scene.seed = hash(seed, 12);
  scene.lighting = roomLighting();
  Random random(hash(seed, 11));
  Builder builder(&random, &scene);
  Furnisher furnisher(&random, &builder);

  std::vector<double> borders = {0.0};
  for (int i = 0; i < kRooms; ++i) borders.push_back(borders.back() + random.uniform(5.6, 7.2));
  const double length = borders.back();
  const double back = kHallway + kWallThickness;  // where rooms begin
  const double doors_y = back + 0.5 * kDepth;
  const auto finish = [&random](Pattern floor) {
    Interior interior;
    interior.wall =
        make(Pattern::kRough, random.uniform(0.5, 0.75), random.uniform(0.04, 0.09), &random);
    interior.floor = makeGrid(floor, random.uniform(0.25, 0.45), 0.3,
                              {random.uniform(0.3, 1.4), random.uniform(0.12, 0.5)}, &random);
    interior.ceiling = makeGrid(Pattern::kTiles, 0.8, 0.06, {0.6, 0.6}, &random);
    interior.trim = make(Pattern::kPlain, random.uniform(0.15, 0.85), 0.05, &random);
    interior.door = makeGrid(Pattern::kPanels, random.uniform(0.2, 0.6), 0.15, {0.5, 0.7}, &random);
    return interior;
  };

  const Interior hall = finish(Pattern::kTiles);
  builder.addFloor({0.0, 0.0}, {length, kHallway}, hall);
  const double first_door = 0.5 * borders[1];
  const double last_door = 0.5 * (borders[kRooms - 1] + length);
  const WallSide outer{{0.0, 0.0}, {length, 0.0}, {}};
  const WallSide inner{
      {length, kHallway}, {0.0, kHallway}, {length - last_door, length - first_door}};
  const WallSide hall_end{{length, 0.0}, {length, kHallway}, {}};
  const WallSide hall_begin{{0.0, kHallway}, {0.0, 0.0}, {}};
  for (const WallSide& side : {outer, inner, hall_end, hall_begin}) builder.addWall(side, hall);
  furnisher.addPosters(hall_end, {0.1, kHallway - 0.1});
  furnisher.addPosters(hall_begin, {0.1, kHallway - 0.1});
  for (double x = 1.0; x < length - 3.0; x += 4.2) {
    builder.addDoor(outer, x + 0.6, hall);
    furnisher.addPosters(outer, {x + 1.4, x + 4.0});
    builder.addLamp({x + 2.0, 0.5 * kHallway}, {1.2, 0.3});
  }
  for (int room = 1; room + 1 < kRooms; ++room) {
    const double middle = length - 0.5 * (borders[room] + borders[room + 1]);
    builder.addDoor(inner, middle, hall);
    furnisher.addPosters(inner, {middle + 0.8, middle + 2.6});
  }

  for (int room = 0; room < kRooms; ++room) {
    const Interior interior = finish(random.chance(0.5) ? Pattern::kTiles : Pattern::kRough);
    const double left = borders[room] + (room > 0 ? 0.5 * kWallThickness : 0.0);
    const double right = borders[room + 1] - (room + 1 < kRooms ? 0.5 * kWallThickness : 0.0);
    const double far = back + kDepth;
    const bool leads_to_hall = room == 0 || room + 1 == kRooms;
    builder.addFloor({left, back}, {right, far}, interior);
    // The sill of the door to the hallway lies between the two floors.
    const double hall_door = room == 0 ? first_door : last_door;
    WallSide front{{left, back}, {right, back}, {}};
    if (leads_to_hall) front.doorways = {hall_door - left};
    WallSide east{{right, back}, {right, far}, {}};
    if (room + 1 < kRooms) east.doorways = {doors_y - back};
    const WallSide rear{{right, far}, {left, far}, {}};
    WallSide west{{left, far}, {left, back}, {}};
    if (room > 0) west.doorways = {far - doors_y};
    for (const WallSide& side : {front, east, rear, west}) builder.addWall(side, interior);

    const double width = right - left;
    furnisher.addShelf(rear, 0.25 * width, random.uniform(1.2, 0.45 * width));
    furnisher.addPosters(rear, {0.52 * width, width - 0.2});
    furnisher.addPosters(east, {0.2, 0.5 * kDepth - 0.8});
    furnisher.addPosters(west, {0.5 * kDepth + 0.8, kDepth - 0.2});
    if (!leads_to_hall) furnisher.addShelf(front, 0.5 * width, 0.5 * width);
    furnisher.addTable({left + random.uniform(0.3, 0.7) * width, far - 1.3});
    furnisher.addCrates({left + 0.8, back + 0.7});
    furnisher.addCrates({right - 0.8, far - 0.6});
    builder.addLamp({left + 0.5 * width, doors_y}, {1.2, 0.6});
  }
  // The floor within the doorways between rooms, and those to the hallway.
  Interior sill = hall;
  sill.floor = make(Pattern::kPlain, 0.25, 0.1, &random);
  for (int room = 1; room < kRooms; ++room) {
    builder.addFloor({borders[room] - 0.5 * kWallThickness, doors_y - 0.5 * kDoorWidth},
                     {borders[room] + 0.5 * kWallThickness, doors_y + 0.5 * kDoorWidth}, sill);
  }
  for (const double x : {first_door, last_door}) {
    builder.addFloor({x - 0.5 * kDoorWidth, kHallway}, {x + 0.5 * kDoorWidth, back}, sill);
  }

  constexpr double kHeight = 1.4;
  constexpr double kTurn = 1.2;
  scene.course = Course({{first_door, 0.5 * kHallway, kHeight},
                         {last_door, 0.5 * kHallway, kHeight + 0.15},
                         {last_door, doors_y, kHeight},
                         {first_door, doors_y, kHeight - 0.15}},
                        kTurn, flightStyle(), hash(seed, 13));
  return scene;
}

// A corridor round four corners.
Scene makeCorridor(std::uint32_t seed) {
  constexpr double kWidth = 2.2;
  Scene scene;
  scene.seed = hash(seed, 22);
  scene.lighting = roomLighting();
  Random random(hash(seed, 21));
  Builder builder(&random, &scene);
  const Vector2d size(random.uniform(20.0, 26.0), random.uniform(12.0, 16.0));

  Interior interior;
  interior.wall = make(Pattern::kPlain, random.uniform(0.55, 0.75), 0.03, &random);
  interior.floor = make(Pattern::kPlain, random.uniform(0.3, 0.4), 0.05, &random);
  interior.ceiling = make(Pattern::kPlain, 0.8, 0.02, &random);
  interior.trim = make(Pattern::kPlain, random.uniform(0.15, 0.3), 0.03, &random);
  interior.door = make(Pattern::kPlain, random.uniform(0.3, 0.5), 0.03, &random);
  const Vector2d low(0.0, 0.0);
  const Vector2d inner_low(kWidth, kWidth);
  const Vector2d inner_high = size - inner_low;
  builder.addFloor({0.0, 0.0}, {size.x(), kWidth}, interior);
  builder.addFloor({0.0, size.y() - kWidth}, {size.x(), size.y()}, interior);
  builder.addFloor({0.0, kWidth}, {kWidth, size.y() - kWidth}, interior);
  builder.addFloor({size.x() - kWidth, kWidth}, {size.x(), size.y() - kWidth}, interior);
  const std::vector<WallSide> outer = {{low, {size.x(), 0.0}, {}},
                                       {{size.x(), 0.0}, size, {}},
                                       {size, {0.0, size.y()}, {}},
                                       {{0.0, size.y()}, low, {}}};
  const std::vector<WallSide> inner = {{inner_low, {inner_low.x(), inner_high.y()}, {}},
                                       {{inner_low.x(), inner_high.y()}, inner_high, {}},
                                       {inner_high, {inner_high.x(), inner_low.y()}, {}},
                                       {{inner_high.x(), inner_low.y()}, inner_low, {}}};
  const Material rail = make(Pattern::kPlain, 0.2, 0.03, &random);
  const Material pipe = make(Pattern::kPlain, 0.45, 0.03, &random);
  for (const WallSide& side : outer) {
    builder.addWall(side, interior);
    builder.addAtWall(side, {0.5 * side.length(), 2.45}, {side.length(), 0.12, 0.12}, pipe);
    double begin = 0.2;  // of the handrail between two doors
    for (double x = 2.0; x < side.length() - 1.5; x += random.uniform(3.0, 4.5)) {
      builder.addDoor(side, x, interior);
      const double end = x - 0.5 * kDoorWidth - 0.15;
      builder.addAtWall(side, {0.5 * (begin + end), 0.95}, {end - begin, 0.06, 0.05}, rail);
      begin = x + 0.5 * kDoorWidth + 0.15;
    }
  }
  for (const WallSide& side : inner) {
    builder.addWall(side, interior);
    for (double x = 1.5; x < side.length() - 1.0; x += random.uniform(2.5, 4.0)) {
      if (random.chance(0.6)) {
        builder.addDoor(side, x, interior);
      } else {
        builder.addAtWall(side, {x, 0.0}, {0.35, 0.16, kCeiling}, interior.trim);
      }
    }
  }
  for (double x = 1.1; x < size.x(); x += 2.6) {
    builder.addLamp({x, 0.5 * kWidth}, {1.2, 0.3});
    builder.addLamp({x, size.y() - 0.5 * kWidth}, {1.2, 0.3});
  }
  for (double y = 3.4; y < size.y() - 3.0; y += 2.6) {
    builder.addLamp({0.5 * kWidth, y}, {0.3, 1.2});
    builder.addLamp({size.x() - 0.5 * kWidth, y}, {0.3, 1.2});
  }

  constexpr double kHeight = 1.4;
  const double middle = 0.5 * kWidth;
  scene.course = Course({{middle, middle, kHeight},
                         {size.x() - middle, middle, kHeight},
                         {size.x() - middle, size.y() - middle, kHeight},
                         {middle, size.y() - middle, kHeight}},
                        1.2, flightStyle(), hash(seed, 23));
  return scene;
}

}  // namespace point_line_odometry::world
