#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <algorithm>
#include <vector>

#include "point_line_odometry/features.h"

namespace point_line_odometry {

/// Looks up segments by a box: each is registered in the square cells that it crosses. Cells
/// outside belong to the border.
class SegmentGrid {
 public:
  explicit SegmentGrid(const std::vector<LineSegment>& segments) {
    for (const LineSegment& segment : segments) {
      high_ = high_.cwiseMax(segment.start).cwiseMax(segment.end);
    }
    columns_ = cell(high_.x()) + 1;
    rows_ = cell(high_.y()) + 1;
    cells_.resize(static_cast<std::size_t>(columns_) * rows_);
    seen_.assign(segments.size(), 0);
    for (std::size_t i = 0; i < segments.size(); ++i) add(static_cast<int>(i), segments[i]);
  }

  /// Calls visit(i) once for every segment that crosses a cell which the box touches.
  template <typename Visit>
  void forEachNear(const Eigen::AlignedBox2f& box, Visit&& visit) const {
    if (seen_.empty()) return;
    ++query_;
    for (int r = clampRow(box.min().y()); r <= clampRow(box.max().y()); ++r) {
      for (int c = clampColumn(box.min().x()); c <= clampColumn(box.max().x()); ++c) {
        for (const int i : cells_[static_cast<std::size_t>(r) * columns_ + c]) {
          if (seen_[i] == query_) continue;
          seen_[i] = query_;
          visit(i);
        }
      }
    }
  }

 private:
  static constexpr float kCellPx = 40.0F;

  static int cell(float x) { return static_cast<int>(std::max(x, 0.0F) / kCellPx); }
  int clampColumn(float u) const { return std::clamp(cell(u), 0, columns_ - 1); }
  int clampRow(float v) const { return std::clamp(cell(v), 0, rows_ - 1); }

  void add(int index, const LineSegment& segment) {
    const int steps = static_cast<int>(segment.length() / (0.5F * kCellPx)) + 1;
    std::size_t last = cells_.size();
    for (int k = 0; k <= steps; ++k) {
      const Eigen::Vector2f p =
          segment.start + (segment.end - segment.start) * (static_cast<float>(k) / steps);
      const std::size_t here =
          static_cast<std::size_t>(clampRow(p.y())) * columns_ + clampColumn(p.x());
      if (here != last) cells_[here].push_back(index);
      last = here;
    }
  }

  Eigen::Vector2f high_ = Eigen::Vector2f::Zero();
  int columns_ = 1;
  int rows_ = 1;
  std::vector<std::vector<int>> cells_;
  mutable std::vector<unsigned> seen_;  // query that visited the segment last
  mutable unsigned query_ = 0;
};

}  // namespace point_line_odometry
