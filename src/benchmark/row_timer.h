#pragma once

#include <benchmark/benchmark.h>

#include <chrono>
#include <ctime>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <optional>
#include <string>
#include <vector>

#include "point_line_odometry/types.h"

namespace point_line_odometry {

using BenchmarkClock = std::chrono::steady_clock;

/// Time since then [ms].
inline double elapsedMs(BenchmarkClock::time_point since) {
  return std::chrono::duration<double, std::milli>(BenchmarkClock::now() - since).count();
}

/// Wall time of a call, and processor time of all threads [ms].
struct CallTime {
  double wall_ms = 0.0;
  double cpu_ms = 0.0;
};

/// Measures the time since its construction.
class Stopwatch {
 public:
  CallTime elapsed() const { return {elapsedMs(wall_begin_), cpuMs() - cpu_begin_ms_}; }

 private:
  static double cpuMs() {
    timespec time{};
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &time);
    return 1e3 * static_cast<double>(time.tv_sec) + 1e-6 * static_cast<double>(time.tv_nsec);
  }

  double cpu_begin_ms_ = cpuMs();
  BenchmarkClock::time_point wall_begin_ = BenchmarkClock::now();
};

/// The times of many calls [ms].
struct CallTimes {
  std::vector<double> wall_ms;
  std::vector<double> cpu_ms;

  void add(const CallTime& time) {
    wall_ms.push_back(time.wall_ms);
    cpu_ms.push_back(time.cpu_ms);
  }
};

/// OpenCV's line segment detector (LSD_REFINE_STD), which runs on one thread: all times are given
/// relative to it, as computers differ and drift.
class Yardstick {
 public:
  /// Some versions of OpenCV (4.1.0 to 4.5.3) have the class, but no detector in it.
  Yardstick();

  bool available() const { return !detector_.empty(); }

  /// Segments of a CV_8UC1 image. available() must be true.
  std::vector<LineSegment> detect(const cv::Mat& image) const;

 private:
  cv::Ptr<cv::LineSegmentDetector> detector_;
};

/// Message of a row that needs the detector if this OpenCV has none.
extern const char* const kNoYardstick;

/// "OpenCV 4.6.0"
std::string openCvVersion();

/// Measures the times of the calls of a row. Between them it calls the yardstick, so that both run
/// under the same conditions: once before the first call, and again whenever the calls have taken
/// `pace` times as long as a call of the yardstick.
class RowTimer {
 public:
  RowTimer(benchmark::State* state, double pace) : state_(state), pace_(pace) {}

  /// Times one call, which is one iteration of the row. \param image input of the yardstick.
  template <typename Call>
  void time(const cv::Mat& image, const Call& call) {
    measureYardstick(image);
    const Stopwatch stopwatch;
    call();
    take(stopwatch.elapsed());
  }

  /// Adds the row's counters: median_ms and p95_ms [ms], vs_lsd (mean / mean of the yardstick)
  /// and cpu_vs_lsd (the same of the processor's times, which other programs hardly change), both
  /// missing without yardstick, and found (number of results of a call).
  void report(std::size_t found) const;

 private:
  void measureYardstick(const cv::Mat& image);
  void take(const CallTime& time);

  benchmark::State* state_;
  double pace_;
  Yardstick yardstick_;
  CallTimes times_;
  CallTimes yardstick_times_;
  double since_yardstick_ms_ = 0.0;
};

/// OpenCV uses one thread while this exists.
class SingleThread {
 public:
  SingleThread() : before_(cv::getNumThreads()) { cv::setNumThreads(1); }
  ~SingleThread() { cv::setNumThreads(before_); }
  SingleThread(const SingleThread&) = delete;
  SingleThread& operator=(const SingleThread&) = delete;

 private:
  int before_;
};

}  // namespace point_line_odometry
