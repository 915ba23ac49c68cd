#pragma once

#include <point_line_odometry/DumpRecording.h>
#include <ros/callback_queue.h>
#include <ros/node_handle.h>
#include <ros/service_server.h>

#include <atomic>
#include <chrono>
#include <memory>
#include <optional>
#include <string>
#include <thread>

#include "ros/frame_messages.h"
#include "ros/frame_ring.h"
#include "ros/log_throttle.h"
#include "ros/recording_writer.h"

namespace point_line_odometry {

/// Keeps the latest frames of the odometry and writes them to disk when the service
/// `dump_recording` is called and when the state becomes LOST: once for each loss, and not more
/// often than `recorder/lost_period_s`. A thread of its own writes and answers the service. The
/// images of a recording stay in memory while it is written, one recording of each kind at most.
/// Errors are logged and never disturb the odometry.
class FlightRecorder {
 public:
  /// \param private_nh where the service is offered.
  FlightRecorder(const ros::NodeHandle& private_nh, const RecordingTarget& target);

  /// Returns when all requested recordings are written.
  ~FlightRecorder();
  FlightRecorder(const FlightRecorder&) = delete;
  FlightRecorder& operator=(const FlightRecorder&) = delete;

  /// To be called before the odometry processes a frame.
  void prepare(const FrameStart& start);

  /// To be called after that, by the same thread, if the frame was accepted.
  void add(const StereoMessages& messages, const ProcessedFrame& frame);

 private:
  using Clock = std::chrono::steady_clock;

  bool dump(DumpRecording::Request& request, DumpRecording::Response& response);
  void watchForLoss(TrackingState state);
  void writeLoss(const Recording& recording);
  void write();

  const RecordingTarget target_;
  const std::unique_ptr<FrameRing> ring_;  // null: disabled
  std::shared_ptr<const Parameters> parameters_;
  bool was_lost_ = false;
  LogThrottle log_throttle_;
  std::optional<Clock::time_point> last_loss_;

  std::atomic<bool> writing_loss_{false};
  std::atomic<bool> stopped_{false};
  ros::CallbackQueue tasks_;
  ros::NodeHandle nh_;
  ros::ServiceServer service_;
  std::thread writer_;
};

}  // namespace point_line_odometry
