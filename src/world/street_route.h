#pragma once

#include <Eigen/Core>
#include <vector>

#include "world/hill.h"
#include "world/random.h"

namespace point_line_odometry::world {

/// Crossings of a closed drive around some blocks, with turns to both sides [blocks].
std::vector<Eigen::Vector2d> chooseCrossings(Random* random);

/// Crossings of a drive that comes to the town along the x axis from `outside` blocks before it.
std::vector<Eigen::Vector2d> chooseCrossingsFromOutside(double outside, Random* random);

/// The polygon moved to the right of its direction, into the driver's lane, at a height [m].
std::vector<Eigen::Vector3d> toTheRight(const std::vector<Eigen::Vector2d>& corners, double offset,
                                        double height);

/// The polygon with the first of its edges, which runs along x, led over a hill.
std::vector<Eigen::Vector3d> overTheHill(const std::vector<Eigen::Vector3d>& corners,
                                         const Hill& hill);

}  // namespace point_line_odometry::world
