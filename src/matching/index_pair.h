#pragma once

namespace point_line_odometry {

/// A match: indices of corresponding elements in two lists.
struct IndexPair {
  int first = -1;
  int second = -1;
};

}  // namespace point_line_odometry
