#include "tools/doctor_pairs.h"

#include <algorithm>
#include <chrono>
#include <exception>
#include <optional>
#include <vector>

#include "common/statistics.h"
#include "ros/frame_processor.h"

namespace point_line_odometry {

void DoctorPairs::take(const StereoMessages& set, double time_s) {
  sets_.push_back(set);
  if (sets_.size() > kept_) sets_.pop_front();
  constexpr double kPause_s = 0.3;
  constexpr std::size_t kMeasured = PairTrend::kWindow;
  if (to_measure_.size() >= kMeasured) return;
  if (!to_measure_.empty() && time_s - last_s_ < kPause_s) return;
  to_measure_.push_back(set);
  last_s_ = time_s;
}

void DoctorPairs::measure(DoctorChecks* checks) const {
  for (const StereoMessages& set : to_measure_) checks->measure(set);
  for (const StereoMessages& set : sets_) checks->follow(set);
}

std::set<ros::Time> DoctorPairs::stamps() const {
  std::set<ros::Time> stamps;
  const auto add = [&](const StereoMessages& set) {
    stamps.insert({set.left->header.stamp, set.right->header.stamp});
  };
  for (const StereoMessages& set : to_measure_) add(set);
  for (const StereoMessages& set : sets_) add(set);
  return stamps;
}

void DoctorPairs::addMasks(MaskBuffer* masks) {
  std::vector<StereoMessages*> sets;
  for (StereoMessages& set : to_measure_) sets.push_back(&set);
  for (StereoMessages& set : sets_) sets.push_back(&set);
  // In order, as the buffer drops what is older; some are in both lists.
  std::stable_sort(sets.begin(), sets.end(), [](const auto* a, const auto* b) {
    return a->left->header.stamp < b->left->header.stamp;
  });
  const StereoMessages* last = nullptr;
  for (StereoMessages* set : sets) {
    *set = last != nullptr && last->left == set->left ? *last : masks->withMasks(*set);
    last = set;
  }
}

void DoctorPairs::process(const AllParameters& parameters, DoctorFacts* facts) const {
  using Clock = std::chrono::steady_clock;
  std::vector<double> times_ms;
  std::vector<ImageMotion> motions;
  std::vector<std::int64_t> motion_ends_ns;
  MaskFacts masks;
  std::optional<FrameProcessor> processor;
  try {
    processor.emplace(parameters);
  } catch (const std::exception&) {
    return;  // the line on masks has the reason
  }
  for (const StereoMessages& set : sets_) {
    try {
      const Clock::time_point begin = Clock::now();
      const ProcessedFrame frame = processor->process(set, Eigen::Isometry3d::Identity());
      times_ms.push_back(std::chrono::duration<double, std::milli>(Clock::now() - begin).count());
      masks.add(frame);
      if (frame.result.state != TrackingState::kOk || !frame.result.image_motion) continue;
      motions.push_back(*frame.result.image_motion);
      motion_ends_ns.push_back(frame.result.stamp_ns);
    } catch (const std::exception&) {
      continue;  // where it is the messages', the lines on images and calibration have the reason
    }
  }
  if (masks.frames > 0) facts->masks = masks;
  if (facts->imu && facts->imu->R_camera_imu) {
    ImuCheckFacts& imu = *facts->imu;
    imu.fit = fitRates(imu.samples, motions, motion_ends_ns, *imu.R_camera_imu, imu.parameters);
  }
  if (times_ms.size() < 2) return;
  facts->frame_ms = median(std::vector<double>(times_ms.begin() + 1, times_ms.end()));
}

}  // namespace point_line_odometry
