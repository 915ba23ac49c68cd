#pragma once

#include "point_line_odometry/matching.h"
#include "point_line_odometry/types.h"

namespace point_line_odometry {

/// Number of differing bits, 0 ... 256.
int hammingDistance(const Descriptor& a, const Descriptor& b);

/// Distances of one descriptor to others: distances[k] is that to to[places[k]].
void hammingDistances(const Descriptor& from, const Descriptor* to, const int* places, int count,
                      int* distances);

/// Distances of one stereo point to others, those of the left and right descriptors added.
void hammingDistances(const StereoDescriptor& from, const StereoDescriptor* to, int count,
                      int* distances);

/// Keeps the best and second-best candidate of a search.
struct BestTwo {
  int best_index = -1;
  int best = 2 * 256 + 1;  // more than any distance
  int second = 2 * 256 + 1;

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
