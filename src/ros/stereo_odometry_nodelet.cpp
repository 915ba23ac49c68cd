#include "ros/stereo_odometry_nodelet.h"

#include <chrono>
#include <exception>
#include <pluginlib/class_list_macros.hpp>

#include "odometry/stage_timer.h"
#include "ros/conversions.h"

namespace point_line_odometry {
namespace {

constexpr double kWarnPeriodS = 5.0;
constexpr double kDiagnosticsPeriodS = 1.0;
constexpr std::chrono::milliseconds kTransformRetry{20};

}  // namespace

StereoOdometryNodelet::~StereoOdometryNodelet() {
  diagnostics_timer_.stop();
  for (ros::ServiceServer& service : services_) service.shutdown();
  doctor_.reset();
  reconfiguration_.reset();
  subscriber_.reset();
  if (queue_) queue_->stop();
  if (worker_.joinable()) worker_.join();
}

void StereoOdometryNodelet::onInit() {
  try {
    start(loadNodeParameters(getPrivateNodeHandle()));
  } catch (const std::exception& error) {
    NODELET_FATAL("%s does not start: %s", getName().c_str(), error.what());
    throw;
  }
}

void StereoOdometryNodelet::start(const AllParameters& parameters) {
  const ros::NodeHandle& nh = getNodeHandle();
  const ros::NodeHandle& private_nh = getPrivateNodeHandle();
  parameters_ = parameters.node;
  governor_ = ComputeGovernor(parameters_.target_frame_time_ms);
  tf_listener_ = std::make_unique<tf2_ros::TransformListener>(tf_buffer_, nh);
  publishers_ = std::make_unique<Publishers>(nh, parameters_);
  diagnostics_ = std::make_unique<Diagnostics>(nh, private_nh, parameters_, getName());
  processor_ = std::make_unique<FrameProcessor>(parameters);
  startRecorder();
  queue_ = std::make_unique<FrameQueue<StereoMessages>>(
      static_cast<std::size_t>(parameters_.queue_size));
  worker_ = std::thread(&StereoOdometryNodelet::work, this);
  offerServices();
  // In the queue of all other callbacks: the thread that runs one of them may be the last to let go
  // of the nodelet, and the manager has freed its other queue by then.
  reconfiguration_ = std::make_unique<Reconfiguration>(
      private_nh, parameters.core, [this](const Parameters& core) {
        const std::lock_guard<std::mutex> lock(request_mutex_);
        requested_parameters_ = core;
      });
  subscriber_ = std::make_unique<StereoSubscriber>(
      nh, private_nh, parameters_, [this](const StereoMessages& m) { takeMessages(m); },
      [this](const std::string& text) { diagnostics_->noteRejectedStamp(text); });
  doctor_ =
      std::make_unique<Doctor>(nh, parameters_, getName(),
                               Doctor::Patient{subscriber_.get(), &tf_buffer_, diagnostics_.get()});
  diagnostics_timer_ = getNodeHandle().createWallTimer(
      ros::WallDuration(kDiagnosticsPeriodS),
      [this](const ros::WallTimerEvent&) { diagnostics_->update(*subscriber_); });
}

void StereoOdometryNodelet::offerServices() {
  ros::NodeHandle& nh = getPrivateNodeHandle();
  services_ = {
      nh.advertiseService("reset", &StereoOdometryNodelet::reset, this),
      nh.advertiseService("reset_to_pose", &StereoOdometryNodelet::resetToPose, this),
      nh.advertiseService("pause", &StereoOdometryNodelet::pause, this),
      nh.advertiseService("resume", &StereoOdometryNodelet::resume, this),
  };
}

void StereoOdometryNodelet::startRecorder() {
  const std::string name_space = getNodeHandle().getNamespace();
  recorder_ = std::make_unique<FlightRecorder>(
      getPrivateNodeHandle(),
      RecordingTarget{name_space == "/" ? "" : name_space, getName(), parameters_});
  processor_->observeStarts([this](const FrameStart& start) { recorder_->prepare(start); });
}

void StereoOdometryNodelet::takeMessages(const StereoMessages& messages) {
  if (paused_) return;
  if (!queue_->push(messages)) diagnostics_->noteDropped();
}

bool StereoOdometryNodelet::reset(Trigger::Request&, Trigger::Response& response) {
  requestPose(initialPose(parameters_));
  response.success = true;
  response.message = "the next frame is the first one, at initial_pose";
  return true;
}

bool StereoOdometryNodelet::resetToPose(ResetToPose::Request& request,
                                        ResetToPose::Response& response) {
  try {
    requestPose(toIsometry(request.pose));
    response.success = true;
    response.message = "the next frame is the first one, at the given pose";
  } catch (const MessageError& error) {
    response.success = false;
    response.message = error.what();
  }
  return true;
}

bool StereoOdometryNodelet::pause(Trigger::Request&, Trigger::Response& response) {
  paused_ = true;
  queue_->clear();
  diagnostics_->notePaused(true);
  response.success = true;
  response.message = "frames are ignored until ~resume is called";
  return true;
}

bool StereoOdometryNodelet::resume(Trigger::Request&, Trigger::Response& response) {
  paused_ = false;
  diagnostics_->notePaused(false);
  response.success = true;
  response.message = "going on from the last pose";
  return true;
}

void StereoOdometryNodelet::requestPose(const Eigen::Isometry3d& T_odom_base) {
  queue_->clear();
  const std::lock_guard<std::mutex> lock(request_mutex_);
  requested_T_odom_base_ = T_odom_base;
}

void StereoOdometryNodelet::work() {
  const auto ready = [this](const StereoMessages& messages) { return knowsMounting(messages); };
  while (const auto messages = queue_->popWhen(ready, kTransformRetry)) {
    processSafely(*messages);
  }
}

/// An exception that left this thread would end every nodelet of the manager.
void StereoOdometryNodelet::processSafely(const StereoMessages& messages) {
  try {
    processAndPublish(messages);
  } catch (const MessageError& error) {
    diagnostics_->noteRejected(error.what());
    NODELET_ERROR_THROTTLE(kWarnPeriodS, "frame rejected: %s", error.what());
  } catch (const std::exception& error) {
    diagnostics_->noteException(error.what());
    NODELET_ERROR_THROTTLE(kWarnPeriodS, "frame skipped after an exception: %s", error.what());
  } catch (...) {
    diagnostics_->noteException("of an unknown type");
    NODELET_ERROR_THROTTLE(kWarnPeriodS, "frame skipped after an exception of an unknown type");
  }
}

void StereoOdometryNodelet::processAndPublish(const StereoMessages& messages) {
  const auto begin = StageTimer::Clock::now();
  applyRequests();
  const Eigen::Isometry3d T_base_header = mounting_.take(messages.left->header.frame_id);
  const ProcessedFrame frame = processor_->process(messages, T_base_header);
  if (frame.result.accepted()) recorder_->add(messages, frame);
  if (processor_->startedAnew()) {
    NODELET_WARN("stamps jumped back: the odometry starts again at initial_pose");
    publishers_->clear();
  }
  if (!frame.result.accepted()) {
    NODELET_WARN_THROTTLE(kWarnPeriodS, "frame dropped: %s", toString(frame.result.reason));
  }
  const double latency_ms = latencyMs(frame.header.stamp, ros::Time::now());
  diagnostics_->noteFrame(frame, latency_ms);
  if (frame.result.reason == TrackingReason::kException) {
    diagnostics_->noteException(frame.result.error);
    NODELET_ERROR_THROTTLE(kWarnPeriodS, "motion predicted after an exception: %s",
                           frame.result.error.c_str());
  }
  publishers_->publish(frame, diagnostics_->counters(), latency_ms);
  if (frame.result.accepted()) {
    processor_->setFeatureBudget(governor_.addFrame(StageTimer::elapsedMs(begin)));
  }
}

void StereoOdometryNodelet::applyRequests() {
  std::optional<Eigen::Isometry3d> pose;
  std::optional<Parameters> parameters;
  {
    const std::lock_guard<std::mutex> lock(request_mutex_);
    pose.swap(requested_T_odom_base_);
    parameters.swap(requested_parameters_);
  }
  if (parameters) processor_->setParameters(*parameters);
  if (!pose) return;
  processor_->reset(*pose);
  publishers_->clear();
}

/// Looks up where the camera sits on the robot, without waiting. Never assumes it.
bool StereoOdometryNodelet::knowsMounting(const StereoMessages& messages) {
  const std::string& frame_id = messages.left->header.frame_id;
  try {
    mounting_.prepare(frame_id);
    return true;
  } catch (const std::exception& error) {
    const std::string camera = withoutLeadingSlash(frame_id);
    const std::string text =
        "no transform from " + parameters_.base_frame_id + " to " +
        (camera.empty() ? "the camera, the left image's frame_id is empty" : camera) +
        "; publish it with static_transform_publisher or set base_frame_id to the camera's frame";
    diagnostics_->noteWaitingForTransform(text);
    NODELET_WARN_THROTTLE(kWarnPeriodS, "frames wait: %s (%s)", text.c_str(), error.what());
    return false;
  }
}

Eigen::Isometry3d StereoOdometryNodelet::lookUpMounting(const std::string& camera) const {
  if (camera == parameters_.base_frame_id) return Eigen::Isometry3d::Identity();
  return toIsometry(
      tf_buffer_.lookupTransform(parameters_.base_frame_id, camera, ros::Time(0)).transform);
}

}  // namespace point_line_odometry

PLUGINLIB_EXPORT_CLASS(point_line_odometry::StereoOdometryNodelet, nodelet::Nodelet)
