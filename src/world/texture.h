#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>

#include "world/batch.h"
#include "world/material.h"
#include "world/noise.h"
#include "world/random.h"

/// \file
/// What the patterns of materials are made of. Structures fade to their mean in patches that are
/// larger than they are.
namespace point_line_odometry::world {

/// Remaining contrast of structures of a size after averaging over a window of another size.
inline float visibility(float structure, float window) {
  return clampUnit(1.5F - window / structure);
}

/// Length of the window [x - size / 2, x + size / 2] that lies in [begin, end], at most 0 for none.
inline float overlap(float x, float size, float begin, float end) {
  return std::min(x + 0.5F * size, end) - std::max(x - 0.5F * size, begin);
}

/// Share of the window [x - size / 2, x + size / 2] that lies in [begin, end].
inline float coverage(float x, float size, float begin, float end) {
  return clampUnit(overlap(x, size, begin, end) / size);
}

/// Share of the window that lies in the interval [begin, end] of any period.
inline float periodicCoverage(float x, float size, float period, float begin, float end) {
  const float phase = x - period * static_cast<float>(floorToInt(x / period));
  const auto covered = [=](float to) {
    const auto whole = static_cast<float>(floorToInt(to / period));
    return whole * (end - begin) +
           std::min(end - begin, std::max(0.0F, to - whole * period - begin));
  };
  return clampUnit((covered(phase + 0.5F * size) - covered(phase - 0.5F * size)) / size);
}

/// Byte `index` of a hash as a number in [-1, 1).
inline float tone(std::uint32_t hash, int index) { return 2.0F * unit(hash, index) - 1.0F; }

/// The patches of a batch in units of a grid's cells. Where the grid is not visible, patches are
/// moved to its origin, as their own place may be beyond whole numbers.
struct InCells {
  using Indices = std::array<int, kBatch>;

  Values u;
  Values v;
  Values size_u;
  Values size_v;
  Values seen;     ///< visibility
  Indices column;  ///< first cell that a patch touches
  Indices row;
  int columns = 0;  ///< that the widest patch touches; 0: the grid is visible nowhere
  int rows = 0;

  bool visible() const { return columns > 0; }
};

/// Cells of a material's size, each patch moved by an offset along u. \param structure size of what
/// is in them [cells].
InCells inCellsOf(const Material& m, const PatchBatch& p, const Values& offset, float structure);

/// Adds value(i, column, row) of each cell that a patch i may touch.
template <typename Value>
inline void addCells(const InCells& c, std::size_t n, const Value& value, Values* sum) {
  for (int row = 0; row < c.rows; ++row) {
    for (int column = 0; column < c.columns; ++column) {
      for (std::size_t i = 0; i < n; ++i) {
        (*sum)[i] += value(i, c.column[i] + column, c.row[i] + row);
      }
    }
  }
}

/// Adds noise with knots at multiples of the size.
void addNoise(const PatchBatch& p, float size, std::uint32_t seed, float weight, Values* sum);

/// Adds rectangles with sharp edges, one in every cell of the size, of a tone in [-1, 1].
void addFlecks(const PatchBatch& p, float size, std::uint32_t seed, float weight, Values* sum);

/// Adds stains and grains of all sizes, in about [-1, 1].
void addRoughness(const PatchBatch& p, std::uint32_t seed, float weight, Values* sum);

/// Adds a random tone in [-1, 1] for every cell of a grid, each patch moved by an offset along u.
void addCellTones(const PatchBatch& p, const Material& m, const Values& offset, float weight,
                  Values* sum);

/// Adds soft round spots, one in every cell of a grid and a third to all of it wide, of a tone in
/// [-1, 1] in the middle.
void addRoundSpots(const PatchBatch& p, float cells_per_m, std::uint32_t seed, Values* sum);

}  // namespace point_line_odometry::world
