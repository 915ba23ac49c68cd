#include "ros/flight_recorder.h"

#include <ros/console.h>

#include <exception>
#include <functional>
#include <utility>

namespace point_line_odometry {
namespace {

constexpr double kPollS = 0.1;
constexpr std::size_t kBytesOfMegabyte = 1000000;

class Task : public ros::CallbackInterface {
 public:
  explicit Task(std::function<void()> work) : work_(std::move(work)) {}
  CallResult call() override {
    work_();
    return Success;
  }

 private:
  std::function<void()> work_;
};

std::unique_ptr<FrameRing> makeRing(const NodeParameters& parameters) {
  if (parameters.recorder.frames == 0) return nullptr;
  return std::make_unique<FrameRing>(
      static_cast<std::size_t>(parameters.recorder.frames),
      static_cast<std::size_t>(parameters.recorder.max_memory_mb) * kBytesOfMegabyte);
}

}  // namespace

FlightRecorder::FlightRecorder(const ros::NodeHandle& private_nh, const RecordingTarget& target)
    : target_(target), ring_(makeRing(target.parameters)), nh_(private_nh) {
  nh_.setCallbackQueue(&tasks_);
  service_ = nh_.advertiseService("dump_recording", &FlightRecorder::dump, this);
  writer_ = std::thread(&FlightRecorder::write, this);
}

FlightRecorder::~FlightRecorder() {
  service_.shutdown();
  stopped_ = true;
  writer_.join();
}

void FlightRecorder::prepare(const FrameStart& start) {
  if (!ring_) return;
  try {
    ring_->prepare(start);
    const Parameters& now = start.odometry.parameters();
    if (!parameters_ || !changedParameters(*parameters_, now).empty())
      parameters_ = std::make_shared<const Parameters>(now);
  } catch (const std::exception& error) {
    ring_->clear();
    if (log_throttle_.passes("the flight recorder is reset")) {
      ROS_ERROR("the flight recorder is reset: %s", error.what());
    }
  }
}

void FlightRecorder::add(const StereoMessages& messages, const ProcessedFrame& frame) {
  if (!ring_) return;
  try {
    const FrameNames names{target_.parameters.odom_frame_id, target_.parameters.base_frame_id};
    StereoMessages images = messages;
    images.left_mask = images.right_mask = nullptr;  // those that were used are kept, see below
    ring_->add({images, toOdometry(frame, names), frame.result.state, frame.result.reason,
                frame.result.T_odom_camera, frame.T_base_camera * frame.T_header_camera.inverse(),
                parameters_, frame.masks.left, frame.masks.right, frame.prior, frame.tilt});
    watchForLoss(frame.result.state);
  } catch (const std::exception& error) {
    ring_->clear();
    if (log_throttle_.passes("the flight recorder is reset")) {
      ROS_ERROR("the flight recorder is reset: %s", error.what());
    }
  }
}

void FlightRecorder::watchForLoss(TrackingState state) {
  const bool lost = state == TrackingState::kLost;
  const bool before = std::exchange(was_lost_, lost);
  if (!lost || before || !target_.parameters.recorder.when_lost) return;
  const Clock::time_point now = Clock::now();
  const std::chrono::duration<double> period(target_.parameters.recorder.lost_period_s);
  if ((last_loss_ && now - *last_loss_ < period) || writing_loss_) {
    if (log_throttle_.passes("lost again"))
      ROS_INFO("lost again: no recording is written so soon after the last one");
    return;
  }
  last_loss_ = now;
  writing_loss_ = true;
  tasks_.addCallback(
      boost::make_shared<Task>([this, recording = ring_->recording()] { writeLoss(recording); }));
}

void FlightRecorder::writeLoss(const Recording& recording) {
  try {
    const RecordingFiles files = writeRecording(recording, target_, "lost");
    ROS_WARN("lost: the last %zu frames are in %s", recording.frames.size(), files.yaml.c_str());
  } catch (const std::exception& error) {
    ROS_ERROR("%s", error.what());
  }
  writing_loss_ = false;
}

bool FlightRecorder::dump(DumpRecording::Request&, DumpRecording::Response& response) {
  response.success = false;
  try {
    if (!ring_) throw std::runtime_error("recorder/frames is 0: nothing is recorded");
    const Recording recording = ring_->recording();
    const RecordingFiles files = writeRecording(recording, target_, "asked");
    response.files = {files.bag.string(), files.yaml.string(), files.state.string()};
    response.frames = static_cast<std::uint32_t>(recording.frames.size());
    response.message =
        "rosrun point_line_odometry offline_odometry " + files.yaml.string() + " -o DIR";
    response.success = true;
  } catch (const std::exception& error) {
    response.message = error.what();
    ROS_ERROR("%s", error.what());
  }
  return true;
}

void FlightRecorder::write() {
  while (!stopped_) tasks_.callAvailable(ros::WallDuration(kPollS));
  tasks_.callAvailable();
}

}  // namespace point_line_odometry
