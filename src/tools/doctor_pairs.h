#pragma once

#include <chrono>
#include <deque>
#include <exception>
#include <optional>
#include <vector>

#include "common/statistics.h"
#include "ros/doctor_examination.h"
#include "ros/frame_processor.h"

namespace point_line_odometry {

/// The sets of images that an examination of limited time looks at.
class DoctorPairs {
 public:
  /// Keeps the latest sets, and has some of the first ones measured.
  void take(const StereoMessages& set, double time_s, DoctorExamination* examination) {
    constexpr std::size_t kKept = 10;
    sets_.push_back(set);
    if (sets_.size() > kKept) sets_.pop_front();
    constexpr double kPause_s = 0.3;
    constexpr std::size_t kMeasured = PairTrend::kWindow;
    if (num_measured_ >= kMeasured) return;
    if (num_measured_ > 0 && time_s - last_measured_s_ < kPause_s) return;
    examination->measure(set);
    last_measured_s_ = time_s;
    ++num_measured_;
  }

  /// Time that this computer takes for a frame, the first one not counted [ms]; nothing if there
  /// are fewer than two or they cannot be used.
  std::optional<double> medianFrameMs(const AllParameters& parameters) const {
    using Clock = std::chrono::steady_clock;
    std::vector<double> times_ms;
    try {
      FrameProcessor processor(parameters);
      for (const StereoMessages& set : sets_) {
        const Clock::time_point begin = Clock::now();
        processor.process(set, Eigen::Isometry3d::Identity());
        times_ms.push_back(std::chrono::duration<double, std::milli>(Clock::now() - begin).count());
      }
    } catch (const std::exception&) {
      return std::nullopt;  // the other lines say why
    }
    if (times_ms.size() < 2) return std::nullopt;
    return median(std::vector<double>(times_ms.begin() + 1, times_ms.end()));
  }

 private:
  std::deque<StereoMessages> sets_;
  double last_measured_s_ = 0.0;
  std::size_t num_measured_ = 0;
};

}  // namespace point_line_odometry
