#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

#include "point_line_odometry/types.h"

namespace point_line_odometry {

/// Sorts segments, the longest first, and keeps at most `max_count` of them.
inline void keepLongest(int max_count, std::vector<LineSegment>* segments) {
  std::stable_sort(
      segments->begin(), segments->end(),
      [](const LineSegment& a, const LineSegment& b) { return a.length() > b.length(); });
  if (static_cast<int>(segments->size()) > max_count)
    segments->resize(static_cast<std::size_t>(max_count));
}

}  // namespace point_line_odometry
