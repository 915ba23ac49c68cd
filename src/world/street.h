#pragma once

#include <cstdint>

#include "world/scene.h"

namespace point_line_odometry::world {

struct StreetOptions {
  int moving_objects = 0;
  double open_country = 0.0;  ///< share of the blocks that are meadows
  double hill = 0.0;          ///< height of a hill before the town, in times the usual one
};

/// A drive through a town: house fronts, kerbs, markings, poles, trees, parked and moving cars.
Scene makeStreet(std::uint32_t seed, const StreetOptions& options);

}  // namespace point_line_odometry::world
