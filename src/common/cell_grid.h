#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cstddef>
#include <tuple>
#include <vector>

namespace point_line_odometry {

/// An image divided into square cells with a value each.
template <typename Value>
class CellGrid {
 public:
  CellGrid(int width, int height, int cell_size_px)
      : cell_size_px_(static_cast<float>(cell_size_px)),
        columns_(numCells(width, cell_size_px)),
        cells_(columns_ * numCells(height, cell_size_px)) {}

  /// The value of the cell of a pixel, which must lie in the image.
  Value& at(const Eigen::Vector2f& pixel) { return cells_[indexOf(pixel)]; }
  const Value& at(const Eigen::Vector2f& pixel) const { return cells_[indexOf(pixel)]; }

  /// Sets all values.
  void fill(const Value& value) { std::fill(cells_.begin(), cells_.end(), value); }

  /// All members, for StereoOdometry::saveState().
  auto state() {
    auto& [cell_size_px, columns, cells] = *this;
    return std::tie(cell_size_px, columns, cells);
  }

  /// All values, row by row.
  const std::vector<Value>& cells() const { return cells_; }

 private:
  /// The last one may be narrower than the others.
  static std::size_t numCells(int length_px, int cell_size_px) {
    return static_cast<std::size_t>((length_px + cell_size_px - 1) / cell_size_px);
  }

  std::size_t indexOf(const Eigen::Vector2f& pixel) const {
    return static_cast<std::size_t>(pixel.y() / cell_size_px_) * columns_ +
           static_cast<std::size_t>(pixel.x() / cell_size_px_);
  }

  float cell_size_px_;
  std::size_t columns_;
  std::vector<Value> cells_;
};

}  // namespace point_line_odometry
