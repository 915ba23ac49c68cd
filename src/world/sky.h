#pragma once

#include <cstddef>
#include <cstdint>

#include "world/batch.h"

namespace point_line_odometry::world {

/// The sky of a scene.
struct Sky {
  std::uint32_t seed = 0;
  float clouds = 0.0F;  ///< contrast of clouds on a darker sky, 0 ... 1; 0: bright mist
};

/// Directions in the world (z up) of any length.
struct RayBatch {
  std::size_t size = 0;  ///< so many of the values are used
  Values x;
  Values y;
  Values z;
};

/// Brightness of the sky in each direction.
void skyRadiance(const Sky& sky, const RayBatch& rays, Values* out);

}  // namespace point_line_odometry::world
