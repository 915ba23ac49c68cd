#pragma once

#include <cstdint>
#include <optional>
#include <tuple>

namespace point_line_odometry {

/// The times at which frames were taken, from their stamps. Many drivers stamp an image when it
/// arrives: a busy computer gets one late and the next right after it, or several at once. By such
/// stamps the camera would move a hundred times too fast. A camera takes no image so soon after the
/// last one: the time of a frame is later than that of the frame before by half the mean interval
/// at least. Stamps that are further apart are the times; after others, the times run ahead of the
/// stamps until these have caught up.
class FrameClock {
 public:
  /// Time of a frame with this stamp, if it is the next one [ns].
  std::int64_t timeOf(std::int64_t stamp_ns) const;

  /// The next frame. \param stamp_ns increases from frame to frame.
  void add(std::int64_t stamp_ns);

  /// Of the last frame; nothing before the first one.
  std::optional<std::int64_t> stamp() const { return stamp_ns_; }

  /// From the last frame to the next one with this stamp [s]; 0 for the first frame.
  double secondsTo(std::int64_t stamp_ns) const;

  /// Between the stamps of the latest frames [s]; 0 before the second one.
  double meanInterval() const { return mean_interval_s_; }

  /// All members, for StereoOdometry::saveState().
  auto state() {
    auto& [stamp_ns, time_ns, mean_interval_s, num_intervals] = *this;
    return std::tie(stamp_ns, time_ns, mean_interval_s, num_intervals);
  }

 private:
  std::optional<std::int64_t> stamp_ns_;
  std::int64_t time_ns_ = 0;
  double mean_interval_s_ = 0.0;  // of the stamps
  int num_intervals_ = 0;         // that it is from
};

}  // namespace point_line_odometry
