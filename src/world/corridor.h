#pragma once

#include <cstdint>

#include "world/scene.h"

namespace point_line_odometry::world {

/// A flight along the plain walls of a corridor: few corners, many edges.
Scene makeCorridor(std::uint32_t seed);

}  // namespace point_line_odometry::world
