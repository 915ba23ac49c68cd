#include "world/interior.h"

#include <cmath>

namespace point_line_odometry::world {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

constexpr double kDoorHeight_m = 2.1;
constexpr double kFrame_m = 0.09;

/// Materials of a wall.
struct Finish {
  Material wall;
  Material trim;
};

/// A rectangle that is seen from the room, y > 0 (edges: along x and up).
void addFace(const Eigen::Isometry3d& T, const Vector3d& corner, const Vector3d& edges,
             const Material& material, ObjectBuilder* builder) {
  builder->addRectangle(T * corner, T.linear() * Vector3d(edges.x(), 0.0, 0.0),
                        Vector3d(0.0, 0.0, edges.z()), material);
}

void addWallPiece(const WallSide& side, const Vector2d& range, const Finish& finish,
                  ObjectBuilder* builder) {
  const double length = range.y() - range.x();
  if (length < 1e-6) return;
  const Eigen::Isometry3d T = side.pose();
  addFace(T, {range.y(), 0.0, 0.0}, {-length, 0.0, kCeiling_m}, finish.wall, builder);
  builder->addBox(
      {T * uprightPose({range.x() + 0.5 * length, 0.01, 0.0}, 0.0), {length, 0.02, 0.11}},
      finish.trim);
}

/// The wall over an open door, the sides of the opening and the frame.
void addOpening(const WallSide& side, double middle, const Finish& finish, ObjectBuilder* builder) {
  const Eigen::Isometry3d T = side.pose();
  const double half = 0.5 * kDoorWidth_m;
  addFace(T, {middle + half, 0.0, kDoorHeight_m}, {-kDoorWidth_m, 0.0, kCeiling_m - kDoorHeight_m},
          finish.wall, builder);
  const Vector3d deep = T.linear() * Vector3d(0.0, -0.5 * kWallThickness_m, 0.0);
  const Vector3d up(0.0, 0.0, kDoorHeight_m);
  const Vector3d across = T.linear() * Vector3d(kDoorWidth_m, 0.0, 0.0);
  const Vector3d left = T * Vector3d(middle - half, 0.0, 0.0);
  builder->addRectangle(left + deep, -deep, up, finish.trim);
  builder->addRectangle(left + across, deep, up, finish.trim);
  builder->addRectangle(left + up, across, deep, finish.trim);
  for (const double end : {-1.0, 1.0}) {
    const Vector3d foot(middle + end * (half + 0.5 * kFrame_m), 0.02, 0.0);
    builder->addBox({T * uprightPose(foot, 0.0), {kFrame_m, 0.04, kDoorHeight_m + kFrame_m}},
                    finish.trim);
  }
  builder->addBox(
      {T * uprightPose({middle, 0.02, kDoorHeight_m}, 0.0), {kDoorWidth_m, 0.04, kFrame_m}},
      finish.trim);
}

}  // namespace

Eigen::Isometry3d WallSide::pose() const {
  const Vector2d along = to - from;
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() =
      Eigen::AngleAxisd(std::atan2(along.y(), along.x()), Vector3d::UnitZ()).toRotationMatrix();
  T.translation() << from.x(), from.y(), 0.0;
  return T;
}

void InteriorBuilder::addFloor(const Vector2d& low, const Vector2d& high,
                               const Interior& interior) {
  ObjectBuilder builder;
  const Vector3d x(high.x() - low.x(), 0.0, 0.0);
  const Vector3d y(0.0, high.y() - low.y(), 0.0);
  builder.addRectangle({low.x(), low.y(), 0.0}, x, y, interior.floor);
  builder.addRectangle({low.x(), high.y(), kCeiling_m}, x, -y, interior.ceiling);
  scene_.place(builder.take());
}

void InteriorBuilder::addWall(const WallSide& side, const Interior& interior) {
  ObjectBuilder builder;
  Material wall = interior.wall;
  wall.seed = random_.bits();
  double begin = 0.0;
  for (const double doorway : side.doorways) {
    addWallPiece(side, {begin, doorway - 0.5 * kDoorWidth_m}, {wall, interior.trim}, &builder);
    addOpening(side, doorway, {wall, interior.trim}, &builder);
    begin = doorway + 0.5 * kDoorWidth_m;
  }
  addWallPiece(side, {begin, side.length()}, {wall, interior.trim}, &builder);
  scene_.place(builder.take());
}

void InteriorBuilder::addAtWall(const WallSide& side, const Vector2d& foot, const Vector3d& size,
                                const Material& front, const Material& top) {
  ObjectBuilder builder;
  const Vector3d position_in_side(foot.x(), 0.5 * size.y(), foot.y());
  builder.addBox({side.pose() * uprightPose(position_in_side, 0.0), size}, front, top);
  scene_.place(builder.take());
}

void InteriorBuilder::addDoor(const WallSide& side, double middle, const Interior& interior) {
  Material door = interior.door;
  door.seed = random_.bits();
  addAtWall(side, {middle, 0.0}, {kDoorWidth_m - 0.1, 0.03, kDoorHeight_m - 0.05}, door);
  for (const double end : {-0.5, 0.5}) {
    addAtWall(side, {middle + end * kDoorWidth_m, 0.0}, {kFrame_m, 0.06, kDoorHeight_m},
              interior.trim);
  }
  addAtWall(side, {middle, kDoorHeight_m - 0.02}, {kDoorWidth_m + kFrame_m, 0.06, kFrame_m},
            interior.trim);
  addAtWall(side, {middle + 0.38 * kDoorWidth_m, 1.02}, {0.13, 0.09, 0.03},
            makeMaterial(Pattern::kPlain, 0.3, 0.1, &random_));
}

void InteriorBuilder::addBeam(const Vector2d& from, const Vector2d& to, double width,
                              const Material& material) {
  constexpr double kDepth_m = 0.22;
  const Vector2d middle = 0.5 * (from + to);
  const Vector2d along = to - from;
  const Vector3d position(middle.x(), middle.y(), kCeiling_m - kDepth_m);
  addBox({uprightPose(position, std::atan2(along.y(), along.x())), {along.norm(), width, kDepth_m}},
         material, material);
}

void InteriorBuilder::addLamp(const Vector2d& middle, const Vector2d& size) {
  ObjectBuilder builder;
  Material shine = makeMaterial(Pattern::kPlain, 0.97, 0.0, &random_);
  shine.shines = true;
  const double z = kCeiling_m - 0.05;
  const Vector3d corner(middle.x() - 0.5 * size.x(), middle.y() + 0.5 * size.y(), z);
  const Vector3d x(size.x(), 0.0, 0.0);
  const Vector3d y(0.0, size.y(), 0.0);
  const Vector3d up(0.0, 0.0, 0.05);
  builder.addRectangle(corner, x, -y, shine);
  const Material edge = makeMaterial(Pattern::kPlain, 0.4, 0.05, &random_);
  builder.addRectangle(corner - y, x, up, edge);
  builder.addRectangle(corner - y + x, y, up, edge);
  builder.addRectangle(corner + x, -x, up, edge);
  builder.addRectangle(corner, -y, up, edge);
  scene_.place(builder.take());
}

void InteriorBuilder::addBox(const BoxShape& box, const Material& sides, const Material& top) {
  ObjectBuilder builder;
  builder.addBox(box, sides, top);
  scene_.place(builder.take());
}

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

}  // namespace point_line_odometry::world
