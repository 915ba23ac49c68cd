#pragma once

#include <chrono>
#include <cstddef>
#include <string>

namespace point_line_odometry {

/// Shows the progress of a run on stderr: a bar if that is a terminal, else a line every few
/// seconds.
class ProgressBar {
 public:
  /// \param total number of steps, 0 if unknown. \param quiet true: nothing is shown.
  ProgressBar(std::string what, std::size_t total, bool quiet);

  ~ProgressBar();
  ProgressBar(const ProgressBar&) = delete;
  ProgressBar& operator=(const ProgressBar&) = delete;

  /// One more step is done.
  void step();

 private:
  using Clock = std::chrono::steady_clock;

  void show(double steps_per_s) const;

  std::string what_;
  std::size_t total_;
  bool quiet_;
  bool terminal_;
  std::size_t done_ = 0;
  Clock::time_point begun_ = Clock::now();
  Clock::time_point shown_ = begun_;
};

}  // namespace point_line_odometry
