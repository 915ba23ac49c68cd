#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <optional>

namespace point_line_odometry {

/// Inserts a sample by its stamp, unless there is one of the same stamp or it is older than all
/// that are kept: then it is counted in `faults` (doubled, late). \param kept_ns before the last
/// frame.
template <typename Sample, typename Faults>
void insertSample(const Sample& sample, std::int64_t kept_ns, std::optional<std::int64_t> frame_ns,
                  std::deque<Sample>* samples, Faults* faults) {
  const auto after =
      std::upper_bound(samples->begin(), samples->end(), sample,
                       [](const Sample& a, const Sample& b) { return a.stamp_ns < b.stamp_ns; });
  if (after != samples->begin() && (after - 1)->stamp_ns == sample.stamp_ns) {
    ++faults->doubled;
  } else if (frame_ns && *frame_ns - sample.stamp_ns > kept_ns) {
    ++faults->late;
  } else {
    samples->insert(after, sample);
  }
}

/// Drops a sample if there are more than `max_samples`: the oldest, unless the newest is of more
/// than a minute after the last frame. Such a stamp is of a clock that is, or was, wrong: samples
/// of the right one are older, and would be dropped as they come.
/// \param samples in the order of their stamps (stamp_ns). \param frame_ns stamp of the last frame.
template <typename Sample>
void boundSamples(std::size_t max_samples, std::optional<std::int64_t> frame_ns,
                  std::deque<Sample>* samples) {
  constexpr std::int64_t kMinute_ns = 60'000'000'000;
  if (samples->size() <= max_samples) return;
  if (frame_ns && samples->back().stamp_ns - *frame_ns > kMinute_ns) {
    samples->pop_back();
  } else {
    samples->pop_front();
  }
}

}  // namespace point_line_odometry
