#pragma once

#include <algorithm>
#include <vector>

#include "map/landmark_ids.h"

namespace point_line_odometry {

/// Collects the landmarks of one kind, and their observations, for a bundle adjustment.
template <typename Landmark, typename Listed>
class BundleList {
 public:
  /// \param list empty; it is filled.
  BundleList(const std::vector<Landmark>& landmarks, std::vector<Listed>* list)
      : landmarks_(landmarks), ids_(landmarks), index_(landmarks.size(), -1), list_(*list) {}

  /// Adds the landmarks that a keyframe observed.
  template <typename Entries>
  void add(const Entries& entries) {
    for (const auto& entry : entries) {
      const int i = ids_.indexOf(entry.landmark);
      if (i < 0 || index_[i] >= 0) continue;
      index_[i] = static_cast<int>(list_.size());
      list_.emplace_back();
      list_.back().id = landmarks_[i].id;
      list_.back().estimate = landmarks_[i].estimate;
    }
  }

  /// Adds the observations of a frame of the problem to the landmarks that were added.
  template <typename Entries>
  void observe(const Entries& entries, int frame) {
    for (const auto& entry : entries) {
      const int i = ids_.indexOf(entry.landmark);
      if (i >= 0 && index_[i] >= 0)
        list_[index_[i]].observations.push_back({frame, entry.observation});
    }
  }

  /// Removes the landmarks that one frame alone observed.
  void dropSingle() {
    const auto single = [](const Listed& landmark) { return landmark.observations.size() < 2; };
    list_.erase(std::remove_if(list_.begin(), list_.end(), single), list_.end());
  }

 private:
  const std::vector<Landmark>& landmarks_;
  LandmarkIds ids_;
  std::vector<int> index_;  // of a landmark in the list, or -1
  std::vector<Listed>& list_;
};

}  // namespace point_line_odometry
