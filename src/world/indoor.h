#pragma once

#include <cstdint>

#include "world/scene.h"

namespace point_line_odometry::world {

/// A flight through furnished rooms and a hallway.
Scene makeIndoor(std::uint32_t seed);

}  // namespace point_line_odometry::world
