#pragma once

#include "world/random.h"
#include "world/surface.h"

namespace point_line_odometry::world {

/// A car with its front towards x, standing on z = 0.
Object makeCar(Random* random);

/// A tree with its foot in the origin.
Object makeTree(Random* random);

}  // namespace point_line_odometry::world
