#pragma once

#include <Eigen/Geometry>
#include <vector>

#include "world/random.h"
#include "world/scene.h"

namespace point_line_odometry::world {

constexpr double kCeiling_m = 2.8;
constexpr double kDoorWidth_m = 1.1;
constexpr double kWallThickness_m = 0.2;

/// One side of a wall: from a corner along its foot; seen from the left of that direction.
struct WallSide {
  Eigen::Vector2d from;
  Eigen::Vector2d to;
  std::vector<double> doorways;  ///< middles of open doors, from `from` [m]

  double length() const { return (to - from).norm(); }

  /// x along the foot, y out of the wall into the room, z up.
  Eigen::Isometry3d pose() const;
};

/// Materials of the inside of a building.
struct Interior {
  Material wall;
  Material floor;
  Material ceiling;
  Material trim;  ///< skirting boards and door frames
  Material door;
};

/// Builds rooms into a scene. Objects at a wall are given in the frame of its side.
class InteriorBuilder {
 public:
  InteriorBuilder(Random* random, Scene* scene) : random_(*random), scene_(*scene) {}

  /// Floor and ceiling of a rectangle.
  void addFloor(const Eigen::Vector2d& low, const Eigen::Vector2d& high, const Interior& interior);

  /// A wall with its openings, their frames, and skirting boards.
  void addWall(const WallSide& side, const Interior& interior);

  /// A box that stands against a wall: middle of its foot along the wall, height of the foot, and
  /// size along the wall, out of it and up.
  void addAtWall(const WallSide& side, const Eigen::Vector2d& foot, const Eigen::Vector3d& size,
                 const Material& front, const Material& top);
  void addAtWall(const WallSide& side, const Eigen::Vector2d& foot, const Eigen::Vector3d& size,
                 const Material& material) {
    addAtWall(side, foot, size, material, material);
  }

  /// A closed door with its frame.
  void addDoor(const WallSide& side, double middle, const Interior& interior);

  /// A beam under the ceiling, `width` wide, along the line between two points.
  void addBeam(const Eigen::Vector2d& from, const Eigen::Vector2d& to, double width,
               const Material& material);

  /// A lamp under the ceiling.
  void addLamp(const Eigen::Vector2d& middle, const Eigen::Vector2d& size);

  /// A box anywhere.
  void addBox(const BoxShape& box, const Material& sides, const Material& top);

 private:
  Random& random_;
  Scene& scene_;
};

/// A drone that flies at walking pace.
MotionStyle flightStyle();

/// Ambient light and a little directional light from above.
Lighting roomLighting();

/// The scene of a flight through a building: Building(seed, scene) builds it, and its flight()
/// gives the corners of the trajectory. Different `kind`s get different random numbers from the
/// same seed.
template <typename Building>
Scene makeFlight(std::uint32_t seed, std::uint32_t kind, const MotionStyle& style = flightStyle()) {
  constexpr double kTurn_m = 1.2;
  Scene scene;
  scene.seed = hash(seed, 10 * kind + 2);
  scene.lighting = roomLighting();
  const Building building(hash(seed, 10 * kind + 1), &scene);
  scene.trajectory = CameraTrajectory(building.flight(), kTurn_m, style, hash(seed, 10 * kind + 3));
  return scene;
}

}  // namespace point_line_odometry::world
