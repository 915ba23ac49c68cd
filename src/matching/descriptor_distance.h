#pragma once

#include "features/features.h"

namespace point_line_odometry {

/// Number of differing bits, 0 ... 256.
int hammingDistance(const Descriptor& a, const Descriptor& b);

/// Distances of one descriptor to others: distances[k] is that to to[indices[k]].
void hammingDistances(const Descriptor& from, const Descriptor* to, const int* indices, int count,
                      int* distances);

/// Distances of one stereo point to others: sums of those of the left and right descriptors.
void hammingDistances(const StereoDescriptor& from, const StereoDescriptor* to, int count,
                      int* distances);

/// The two nearest neighbours of a descriptor, for the ratio test (Lowe 2004).
struct TwoNearest {
  int best_index = -1;
  int best = 2 * 256 + 1;  // larger than any distance
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

  /// Index of the nearest if best <= max_distance and best < max_ratio * second, else -1.
  int accepted(int max_distance, double max_ratio) const {
    return best <= max_distance && best < max_ratio * second ? best_index : -1;
  }
};

}  // namespace point_line_odometry
