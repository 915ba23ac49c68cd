#pragma once

#include <vector>

#include "matching/index_pair.h"

namespace point_line_odometry {

/// Cross-check: the pairs (i, forward[i]) with backward[forward[i]] = i. \param forward and \param
/// backward: index of each element's nearest neighbour in the other list, or -1.
inline std::vector<IndexPair> crossCheck(const std::vector<int>& forward,
                                         const std::vector<int>& backward) {
  std::vector<IndexPair> pairs;
  for (std::size_t i = 0; i < forward.size(); ++i) {
    if (forward[i] >= 0 && backward[forward[i]] == static_cast<int>(i))
      pairs.push_back({static_cast<int>(i), forward[i]});
  }
  return pairs;
}

}  // namespace point_line_odometry
