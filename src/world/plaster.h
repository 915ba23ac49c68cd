#pragma once

#include <cstdint>

#include "world/scene.h"

namespace point_line_odometry::world {

/// A fast flight through dark rooms of plaster: soft spots that the noise hides, few edges.
Scene makePlaster(std::uint32_t seed);

}  // namespace point_line_odometry::world
