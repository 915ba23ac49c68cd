#include "benchmark/row_timer.h"

#include <opencv2/core/version.hpp>

#include "common/opencv_lsd.h"
#include "common/statistics.h"
#include "tools/interruption.h"

namespace point_line_odometry {

const char* const kNoYardstick =
    "this OpenCV has no line segment detector (4.1.0 to 4.5.3 have none)";

std::string openCvVersion() { return "OpenCV " CV_VERSION; }

Yardstick::Yardstick() : detector_(createLsd()) {}

std::vector<LineSegment> Yardstick::detect(const cv::Mat& image) const {
  std::vector<cv::Vec4f> lines;
  detector_->detect(image, lines);
  std::vector<LineSegment> segments;
  segments.reserve(lines.size());
  for (const cv::Vec4f& line : lines) segments.push_back({{line[0], line[1]}, {line[2], line[3]}});
  return segments;
}

void RowTimer::measureYardstick(const cv::Mat& image) {
  throwIfInterrupted();
  if (!yardstick_.available()) return;
  const std::vector<double>& before_ms = yardstick_times_.wall_ms;
  if (!before_ms.empty() && since_yardstick_ms_ < pace_ * before_ms.back()) return;
  state_->PauseTiming();
  const SingleThread single_thread;
  const Stopwatch stopwatch;
  yardstick_.detect(image);
  yardstick_times_.add(stopwatch.elapsed());
  since_yardstick_ms_ = 0.0;
  state_->ResumeTiming();
}

void RowTimer::take(const CallTime& time) {
  times_.add(time);
  since_yardstick_ms_ += time.wall_ms;
  state_->SetIterationTime(1e-3 * time.wall_ms);
}

void RowTimer::report(std::size_t found) const {
  state_->counters["median_ms"] = median(times_.wall_ms);
  state_->counters["p95_ms"] = quantile(times_.wall_ms, 0.95);
  state_->counters["found"] = static_cast<double>(found);
  if (yardstick_times_.wall_ms.empty()) return;
  state_->counters["vs_lsd"] = mean(times_.wall_ms) / mean(yardstick_times_.wall_ms);
  state_->counters["cpu_vs_lsd"] = mean(times_.cpu_ms) / mean(yardstick_times_.cpu_ms);
}

}  // namespace point_line_odometry
