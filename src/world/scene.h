#pragma once

#include <Eigen/Geometry>
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

#include "world/camera_trajectory.h"
#include "world/hill.h"
#include "world/surface.h"

namespace point_line_odometry::world {

/// Ambient and directional light.
struct Lighting {
  Eigen::Vector3d direction = Eigen::Vector3d::UnitZ();  ///< unit vector towards the sun
  double ambient = 0.6;
  double direct = 0.4;
};

/// Default exposure of the scene's camera.
struct Exposure {
  double shutter_ms = 0.0;
  int instants = 16;   ///< largest number of samples of the exposure time
  double noise = 1.5;  ///< standard deviation at middle grey [grey levels]
};

/// An object with a pose; many instances may share an object.
struct Instance {
  std::size_t object = 0;
  Eigen::Isometry3d T_world_object = Eigen::Isometry3d::Identity();
};

/// An object that moves along the trajectory of the scene.
struct Mover {
  std::size_t object = 0;
  double start_m = 0.0;        ///< arc length at time 0
  double speed_m_s = 0.0;      ///< negative: backwards
  double to_the_left_m = 0.0;  ///< lateral offset from the trajectory
  double least_gap_m = -1e9;   ///< to the camera behind it: faster than speed_m_s if need be
};

/// The objects and lights of a world, and the trajectory of a camera in it.
struct Scene {
  /// Adds an object for instances of it; returns its index.
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
  CameraTrajectory trajectory;
};

/// Instances of the moving objects at a time. \param camera_m arc length of the camera.
std::vector<Instance> poseMovers(const Scene& scene, double time_s, double camera_m);

/// Makes the patterns of everything level repeat after a length, also those of a road over a hill;
/// 0: never.
void repeatPatterns(double length_m, Scene* scene);

}  // namespace point_line_odometry::world
