#pragma once

#include <Eigen/Geometry>
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

#include "world/course.h"
#include "world/hill.h"
#include "world/surface.h"

namespace point_line_odometry::world {

/// Light that comes from everywhere and light that comes from one direction.
struct Lighting {
  Eigen::Vector3d direction = Eigen::Vector3d::UnitZ();  ///< unit vector towards the sun
  double ambient = 0.6;
  double direct = 0.4;
};

/// How a camera takes the pictures where nothing else is asked for.
struct Exposure {
  double shutter_ms = 0.0;
  int instants = 16;   ///< at which the shutter's time is sampled, at most
  double noise = 1.5;  ///< standard deviation at middle grey [grey levels]
};

/// An object at a place; many instances may share an object.
struct Instance {
  std::size_t object = 0;
  Eigen::Isometry3d T_world_object = Eigen::Isometry3d::Identity();
};

/// An object that travels along the course of the scene.
struct Mover {
  std::size_t object = 0;
  double start_m = 0.0;        ///< arc length at time 0
  double speed_m_s = 0.0;      ///< negative: the other way
  double to_the_left_m = 0.0;  ///< from the course
};

/// A place and a camera's way through it.
struct Scene {
  /// Keeps an object for instances of it; its index.
  std::size_t add(Object object) {
    objects.push_back(std::move(object));
    return objects.size() - 1;
  }

  /// Adds an object that is given in the world's frame.
  void place(Object object) {
    instances.push_back({add(std::move(object)), Eigen::Isometry3d::Identity()});
  }

  std::vector<Object> objects;
  std::vector<Instance> instances;
  std::vector<Mover> movers;
  Lighting lighting;
  Exposure exposure;
  double haze_m = 1e9;  ///< distance at which half of the contrast is left
  double clouds = 0.0;  ///< contrast of clouds in the sky; 0: no more than mist
  Hill hill;
  std::uint32_t seed = 0;
  Course course;
};

struct StreetOptions {
  int moving_objects = 0;
  double open_country = 0.0;  ///< share of the blocks that are meadows
  double hill = 0.0;          ///< height of a hill before the town, in times the usual one
};

/// A drive through a town: house fronts, kerbs, markings, poles, trees, parked and moving cars.
Scene makeStreet(std::uint32_t seed, const StreetOptions& options);

/// A flight through furnished rooms and a hallway.
Scene makeIndoor(std::uint32_t seed);

/// A flight along the plain walls of a corridor: few corners, many edges.
Scene makeCorridor(std::uint32_t seed);

/// A fast flight through dark rooms of plaster: soft spots that the noise hides, few edges.
Scene makePlaster(std::uint32_t seed);

/// Where the objects that move are at a time.
std::vector<Instance> placeMovers(const Scene& scene, double time_s);

}  // namespace point_line_odometry::world
