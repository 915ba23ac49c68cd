#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <vector>

namespace point_line_odometry {

/// Looks up things by their pixel: square cells, contents in one array ordered by cell. Pixels
/// outside go to the border cells.
class PixelGrid {
 public:
  PixelGrid(int width, int height, int cell_px)
      : cell_(cell_px), columns_(width / cell_px + 1), rows_(height / cell_px + 1) {}

  /// Registers element i of `pixels` at its pixel; replaces what was there.
  void fill(const std::vector<Eigen::Vector2f>& pixels) {
    begins_.assign(static_cast<std::size_t>(columns_) * rows_ + 1, 0);
    std::vector<int> cells(pixels.size());
    for (std::size_t i = 0; i < pixels.size(); ++i) {
      cells[i] = row(pixels[i].y()) * columns_ + column(pixels[i].x());
      ++begins_[cells[i] + 1];
    }
    for (std::size_t c = 1; c < begins_.size(); ++c) begins_[c] += begins_[c - 1];
    contents_.resize(pixels.size());
    std::vector<int> next(begins_.begin(), begins_.end() - 1);
    for (std::size_t i = 0; i < pixels.size(); ++i)
      contents_[next[cells[i]]++] = static_cast<int>(i);
  }

  /// Calls visit(i) for every element in the cells that the rectangle touches; the caller tests the
  /// exact place.
  template <typename Visit>
  void forEachNear(const Eigen::Vector2f& low, const Eigen::Vector2f& high, Visit&& visit) const {
    if (begins_.empty()) return;
    for (int r = row(low.y()); r <= row(high.y()); ++r) {
      const int begin = begins_[r * columns_ + column(low.x())];
      const int end = begins_[r * columns_ + column(high.x()) + 1];
      for (int k = begin; k < end; ++k) visit(contents_[k]);
    }
  }

 private:
  int column(float u) const { return std::clamp(static_cast<int>(u) / cell_, 0, columns_ - 1); }
  int row(float v) const { return std::clamp(static_cast<int>(v) / cell_, 0, rows_ - 1); }

  int cell_;
  int columns_;
  int rows_;
  std::vector<int> begins_;  // of each cell in contents_, one more at the end
  std::vector<int> contents_;
};

}  // namespace point_line_odometry
