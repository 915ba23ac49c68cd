#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <algorithm>
#include <vector>

#include "point_line_odometry/types.h"

namespace point_line_odometry {

/// Finds segments by a box: each is registered in the square cells that it crosses. Pixels outside
/// belong to the border cells.
class SegmentGrid {
 public:
  explicit SegmentGrid(const std::vector<LineSegment>& segments) : seen_(segments.size(), 0) {
    Eigen::Vector2f high = Eigen::Vector2f::Zero();
    for (const LineSegment& segment : segments)
      high = high.cwiseMax(segment.start).cwiseMax(segment.end);
    columns_ = cell(high.x()) + 1;
    rows_ = cell(high.y()) + 1;
    // Counting sort as in PointGrid::fill().
    begins_.assign(static_cast<std::size_t>(columns_) * rows_ + 2, 0);
    for (const LineSegment& segment : segments)
      forEachCell(segment, [&](std::size_t c) { ++begins_[c + 2]; });
    for (std::size_t c = 2; c < begins_.size(); ++c) begins_[c] += begins_[c - 1];
    contents_.resize(static_cast<std::size_t>(begins_.back()));
    for (std::size_t i = 0; i < segments.size(); ++i) {
      forEachCell(segments[i],
                  [&](std::size_t c) { contents_[begins_[c + 1]++] = static_cast<int>(i); });
    }
  }

  /// Calls visit(i) once for every segment that crosses a cell which the box touches.
  template <typename Visit>
  void forEachNear(const Eigen::AlignedBox2f& box, Visit&& visit) {
    if (seen_.empty()) return;
    ++query_;
    const int first = clampColumn(box.min().x());
    const int last = clampColumn(box.max().x());
    for (int r = clampRow(box.min().y()); r <= clampRow(box.max().y()); ++r) {
      for (int k = begins_[r * columns_ + first]; k < begins_[r * columns_ + last + 1]; ++k) {
        const int i = contents_[k];
        if (seen_[i] == query_) continue;
        seen_[i] = query_;
        visit(i);
      }
    }
  }

 private:
  static constexpr float kCellPx = 40.0F;

  static int cell(float x) { return static_cast<int>(std::max(x, 0.0F) / kCellPx); }
  int clampColumn(float u) const { return std::clamp(cell(u), 0, columns_ - 1); }
  int clampRow(float v) const { return std::clamp(cell(v), 0, rows_ - 1); }

  /// The cells along a segment; some may be visited twice.
  template <typename Visit>
  void forEachCell(const LineSegment& segment, Visit&& visit) const {
    const int steps = static_cast<int>(segment.length() / (0.5F * kCellPx)) + 1;
    std::size_t last = static_cast<std::size_t>(columns_) * rows_;
    for (int k = 0; k <= steps; ++k) {
      const Eigen::Vector2f p =
          segment.start + (segment.end - segment.start) * (static_cast<float>(k) / steps);
      const std::size_t here =
          static_cast<std::size_t>(clampRow(p.y())) * columns_ + clampColumn(p.x());
      if (here != last) visit(here);
      last = here;
    }
  }

  int columns_ = 1;
  int rows_ = 1;
  std::vector<int> begins_;  // of each cell in contents_, and the end
  std::vector<int> contents_;
  std::vector<unsigned> seen_;  // query that visited the segment last
  unsigned query_ = 0;
};

}  // namespace point_line_odometry
