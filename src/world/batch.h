#pragma once

#include <array>
#include <cstddef>

namespace point_line_odometry::world {

/// Pixels that are shaded together; a multiple of the widest vector.
constexpr std::size_t kBatch = 64;

/// One number for each pixel of a batch.
using Values = std::array<float, kBatch>;

/// The patches of one surface that the pixels of a batch see. Structures that are smaller than a
/// patch fade to their mean.
struct PatchBatch {
  std::size_t size = 0;  ///< so many of the values are used
  Values u;              ///< centre [m]
  Values v;
  Values size_u;  ///< extent [m]
  Values size_v;
  Values slope_u;  ///< sideways shift of the ray per metre behind the surface
  Values slope_v;
};

}  // namespace point_line_odometry::world
