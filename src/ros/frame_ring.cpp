#include "ros/frame_ring.h"

#include <algorithm>
#include <utility>

namespace point_line_odometry {

FrameRing::FrameRing(std::size_t max_frames, std::size_t max_bytes)
    : frames_of_half_(std::max<std::size_t>(max_frames / 2, 1)),
      bytes_of_half_(std::max<std::size_t>(max_bytes / 2, 1)) {}

bool FrameRing::full(const Half& half) const {
  return half.frames.size() >= frames_of_half_ || half.bytes >= bytes_of_half_;
}

/// A mask that does not change is shared by the frames.
std::size_t FrameRing::bytesOf(const RecordedFrame& frame, const RecordedFrame* before) {
  std::size_t bytes = frame.messages.left->data.size() + frame.messages.right->data.size();
  for (cv::Mat RecordedFrame::*mask : {&RecordedFrame::left_mask, &RecordedFrame::right_mask}) {
    const cv::Mat& own = frame.*mask;
    if (before == nullptr || (before->*mask).data != own.data) bytes += own.total();
  }
  return bytes;
}

void FrameRing::prepare(const FrameStart& start) {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (!start.continues) older_ = newer_ = Half();
    if (newer_.start && !full(newer_)) return;
  }
  // Only this thread changes the halves: no lock is needed while the state is saved.
  auto before = std::make_shared<RecordedStart>();
  before->state = start.odometry.saveState();
  before->T_odom_base = start.T_odom_base;
  const std::lock_guard<std::mutex> lock(mutex_);
  if (newer_.start) older_ = std::move(newer_);
  newer_ = Half();
  newer_.start = std::move(before);
}

void FrameRing::add(RecordedFrame frame) {
  const std::lock_guard<std::mutex> lock(mutex_);
  if (!newer_.start) return;
  newer_.bytes += bytesOf(frame, newer_.frames.empty() ? nullptr : &newer_.frames.back());
  newer_.frames.push_back(std::move(frame));
}

void FrameRing::clear() {
  const std::lock_guard<std::mutex> lock(mutex_);
  older_ = newer_ = Half();
}

Recording FrameRing::recording() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  Recording recording{older_.start ? older_.start : newer_.start, older_.frames};
  recording.frames.insert(recording.frames.end(), newer_.frames.begin(), newer_.frames.end());
  return recording;
}

}  // namespace point_line_odometry
