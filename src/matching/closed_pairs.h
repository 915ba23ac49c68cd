#pragma once

#include <vector>

#include "point_line_odometry/matching.h"

namespace point_line_odometry {

/// The pairs (i, forward[i]) whose way back ends where it began. \param forward and \param backward
/// have the index of each element's partner in the other list, or -1.
inline std::vector<IndexPair> closedPairs(const std::vector<int>& forward,
                                          const std::vector<int>& backward) {
  std::vector<IndexPair> pairs;
  for (std::size_t i = 0; i < forward.size(); ++i) {
    if (forward[i] >= 0 && backward[forward[i]] == static_cast<int>(i))
      pairs.push_back({static_cast<int>(i), forward[i]});
  }
  return pairs;
}

}  // namespace point_line_odometry
