#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <vector>

namespace point_line_odometry {

/// Square cells, each of which keeps its strongest corners; without a size, one for all.
struct CornerCells {
  int size_px = 1 << 24;
  int max_per_cell = 1 << 24;
};

/// The score that a corner must exceed to be among the strongest of its cell, given those that the
/// cell has so far; equal scores rank in reading order. It rises as corners are added. For the
/// cells of one row of cells.
class CellThresholds {
 public:
  /// \param width that the cells tile [px]. \param least score to exceed in an empty cell.
  void reset(const CornerCells& cells, int width, int least) {
    max_per_cell_ = cells.max_per_cell;
    cells_.assign(static_cast<std::size_t>((width + cells.size_px - 1) / cells.size_px), {});
    for (Cell& cell : cells_) cell.threshold = least;
  }

  int of(int column) const { return cells_[static_cast<std::size_t>(column)].threshold; }

  /// Of the columns first ... last, the least; the last column ends those beyond it.
  int least(int first, int last) const {
    last = std::min(last, static_cast<int>(cells_.size()) - 1);
    int least = of(first);
    for (int column = first + 1; column <= last; ++column) least = std::min(least, of(column));
    return least;
  }

  /// Adds a corner whose score exceeds the threshold of its cell.
  void add(int column, std::uint8_t score) {
    Cell& cell = cells_[static_cast<std::size_t>(column)];
    ++cell.counts[score];
    ++cell.num_above;
    while (cell.num_above >= max_per_cell_) cell.num_above -= cell.counts[++cell.threshold];
  }

 private:
  struct Cell {
    int threshold = 0;
    int num_above = 0;              // corners that score more than the threshold
    std::array<int, 256> counts{};  // by score
  };

  int max_per_cell_ = 0;
  std::vector<Cell> cells_;
};

}  // namespace point_line_odometry
