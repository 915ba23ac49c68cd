#include "matching/appearance_matcher.h"

#include "matching/cross_check.h"
#include "matching/descriptor_distance.h"

namespace point_line_odometry {

std::vector<StereoDescriptor> stereoDescriptors(const StereoFrame& frame) {
  std::vector<StereoDescriptor> descriptors;
  descriptors.reserve(frame.points.size());
  for (const StereoPoint& point : frame.points) {
    descriptors.push_back({frame.features.points_left[point.left].descriptor,
                           frame.features.points_right[point.right].descriptor});
  }
  return descriptors;
}

std::vector<IndexPair> matchByAppearance(const std::vector<StereoDescriptor>& known,
                                         const std::vector<StereoDescriptor>& seen,
                                         const MatchingParameters& parameters) {
  std::vector<int> distances(seen.size());
  std::vector<int> forward(known.size(), -1);
  std::vector<TwoNearest> backward(seen.size());
  for (std::size_t i = 0; i < known.size(); ++i) {
    hammingDistances(known[i], seen.data(), static_cast<int>(seen.size()), distances.data());
    TwoNearest best;
    for (std::size_t k = 0; k < seen.size(); ++k) {
      best.offer(static_cast<int>(k), distances[k]);
      backward[k].offer(static_cast<int>(i), distances[k]);
    }
    forward[i] = best.accepted(2 * parameters.max_point_distance, parameters.max_distance_ratio);
  }
  std::vector<int> back(seen.size());
  for (std::size_t k = 0; k < seen.size(); ++k) back[k] = backward[k].best_index;
  return crossCheck(forward, back);
}

}  // namespace point_line_odometry
