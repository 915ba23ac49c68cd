#pragma once

#include <cstdlib>

#include "point_line_odometry/types.h"

namespace point_line_odometry {

/// Number of differing bits, 0 ... 256.
inline int hammingDistance(const Descriptor& a, const Descriptor& b) {
  int distance = 0;
  for (std::size_t i = 0; i < a.size(); ++i) distance += __builtin_popcountll(a[i] ^ b[i]);
  return distance;
}

/// Keeps the best and second-best candidate of a search.
struct BestTwo {
  int best_index = -1;
  int best = 257;
  int second = 257;

  void offer(int index, int distance) {
    if (distance < best) {
      second = best;
      best = distance;
      best_index = index;
    } else if (distance < second) {
      second = distance;
    }
  }

  /// Index of the best one if it is near enough and clearly better than the second, else -1.
  int accepted(int max_distance, double max_ratio) const {
    return best <= max_distance && best < max_ratio * second ? best_index : -1;
  }
};

}  // namespace point_line_odometry
