#include "matching/descriptor_distance.h"

#include "common/processor_clones.h"

namespace point_line_odometry {

POINT_LINE_ODOMETRY_CLONES("popcnt")
void hammingDistances(const Descriptor& from, const Descriptor* to, const int* indices, int count,
                      int* distances) {
  for (int k = 0; k < count; ++k) {
    const Descriptor& other = to[indices[k]];
    int distance = 0;
    for (std::size_t i = 0; i < from.size(); ++i)
      distance += __builtin_popcountll(from[i] ^ other[i]);
    distances[k] = distance;
  }
}

POINT_LINE_ODOMETRY_CLONES("popcnt")
void hammingDistances(const StereoDescriptor& from, const StereoDescriptor* to, int count,
                      int* distances) {
  for (int k = 0; k < count; ++k) {
    int distance = 0;
    for (std::size_t i = 0; i < from.left.size(); ++i) {
      distance += __builtin_popcountll(from.left[i] ^ to[k].left[i]);
      distance += __builtin_popcountll(from.right[i] ^ to[k].right[i]);
    }
    distances[k] = distance;
  }
}

int hammingDistance(const Descriptor& a, const Descriptor& b) {
  const int index = 0;
  int distance = 0;
  hammingDistances(a, &b, &index, 1, &distance);
  return distance;
}

}  // namespace point_line_odometry
