#include "matching/appearance_matcher.h"

#include <cstddef>

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

/// Each part of the known ones has its own nearest ones of those seen, which are merged in order.
std::vector<IndexPair> matchByAppearance(const std::vector<StereoDescriptor>& known,
                                         const std::vector<StereoDescriptor>& seen,
                                         const MatchingParameters& parameters,
                                         ThreadPool* threads) {
  std::vector<int> forward(known.size(), -1);
  const auto num_parts = static_cast<std::size_t>(numParts(threads));
  std::vector<std::vector<TwoNearest>> backward(num_parts);
  runParts(threads, known.size(), [&](int part, std::size_t begin, std::size_t end) {
    std::vector<int> distances(seen.size());
    std::vector<TwoNearest>& nearest = backward[static_cast<std::size_t>(part)];
    nearest.resize(seen.size());
    for (std::size_t i = begin; i < end; ++i) {
      hammingDistances(known[i], seen.data(), static_cast<int>(seen.size()), distances.data());
      TwoNearest best;
      for (std::size_t k = 0; k < seen.size(); ++k) {
        best.offer(static_cast<int>(k), distances[k]);
        nearest[k].offer(static_cast<int>(i), distances[k]);
      }
      forward[i] = best.accepted(2 * parameters.max_point_distance, parameters.max_distance_ratio);
    }
  });
  std::vector<int> back(seen.size());
  for (std::size_t k = 0; k < seen.size(); ++k) {
    TwoNearest nearest;
    for (const std::vector<TwoNearest>& of_part : backward)
      nearest.offer(of_part[k].best_index, of_part[k].best);
    back[k] = nearest.best_index;
  }
  return crossCheck(forward, back);
}

}  // namespace point_line_odometry
