#pragma once

#include <algorithm>
#include <cstdint>
#include <vector>

namespace point_line_odometry {

/// The ids of landmarks, which are in ascending order: much faster to search than the landmarks,
/// each of which fills several lines of the cache.
class LandmarkIds {
 public:
  template <typename Landmark>
  explicit LandmarkIds(const std::vector<Landmark>& landmarks) {
    ids_.reserve(landmarks.size());
    for (const Landmark& landmark : landmarks) ids_.push_back(landmark.id);
  }

  /// Index of a landmark, or -1 if it was culled.
  int indexOf(std::uint64_t id) const {
    const auto it = std::lower_bound(ids_.begin(), ids_.end(), id);
    return it != ids_.end() && *it == id ? static_cast<int>(it - ids_.begin()) : -1;
  }

 private:
  std::vector<std::uint64_t> ids_;
};

}  // namespace point_line_odometry
