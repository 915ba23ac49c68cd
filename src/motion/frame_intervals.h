#pragma once

#include <cstdint>
#include <tuple>
#include <vector>

namespace point_line_odometry {

/// The intervals between the stamps of the latest frames. Many drivers stamp an image when it
/// arrives: a busy computer gets one late and the next right after it, or two at nearly the same
/// time, as if the camera had moved a hundred times too fast. No camera takes an image so soon
/// after the last one: two frames are half of the usual interval apart at least.
class FrameIntervals {
 public:
  /// \param interval_s between the stamps of a frame and of the one before.
  void add(double interval_s);

  /// Mean of the latest eight without the longest one, others of more than twice their median cut
  /// to that [s]; 0 of fewer than two, and of a camera slower than a frame per second.
  double usual() const;

  /// Time from a frame to a later one by their stamps, at least half of the usual interval [s].
  double between(std::int64_t earlier_ns, std::int64_t later_ns) const;

  /// All members, for StereoOdometry::saveState().
  auto state() {
    auto& [latest] = *this;
    return std::tie(latest);
  }

 private:
  std::vector<double> latest_s_;  // the oldest first
};

}  // namespace point_line_odometry
