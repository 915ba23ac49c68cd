#include "tools/progress_bar.h"

#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <utility>

namespace point_line_odometry {

ProgressBar::ProgressBar(std::string what, std::size_t total, bool quiet)
    : what_(std::move(what)), total_(total), quiet_(quiet), terminal_(isatty(STDERR_FILENO) == 1) {}

ProgressBar::~ProgressBar() {
  if (!quiet_ && terminal_ && done_ > 0) std::fputc('\n', stderr);
}

void ProgressBar::step() {
  ++done_;
  const Clock::time_point now = Clock::now();
  const std::chrono::duration<double> since_shown = now - shown_;
  const bool due = since_shown.count() >= (terminal_ ? 0.1 : 5.0) || (terminal_ && done_ == total_);
  if (quiet_ || !due) return;
  shown_ = now;
  show(static_cast<double>(done_) / std::chrono::duration<double>(now - begun_).count());
}

void ProgressBar::show(double steps_per_s) const {
  std::string bar;
  if (terminal_ && total_ > 0) {
    constexpr std::size_t kWidth = 40;
    bar.assign(std::min(kWidth, kWidth * done_ / total_), '#');
    bar.resize(kWidth, ' ');
    bar = " [" + bar + "]";
  }
  const std::string of_total = total_ > 0 ? "/" + std::to_string(total_) : "";
  std::fprintf(stderr, "%s%s%s %zu%s, %.1f frames/s%s", terminal_ ? "\r" : "", what_.c_str(),
               bar.c_str(), done_, of_total.c_str(), steps_per_s, terminal_ ? " " : "\n");
}

}  // namespace point_line_odometry
