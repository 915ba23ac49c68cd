#include "ros/stereo_odometry_nodelet.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <exception>
#include <pluginlib/class_list_macros.hpp>

#include "odometry/stage_timer.h"
#include "ros/conversions.h"
#include "ros/parameter_loader.h"
#include "ros/remapped_names.h"
#include "ros/tf_parents.h"

namespace point_line_odometry {
namespace {

constexpr std::chrono::milliseconds kTransformRetry{20};
constexpr std::chrono::milliseconds kMaskRetry{2};

/// As diagnostic_updater, whose parameter it is.
ros::WallDuration diagnosticsPeriod(const ros::NodeHandle& private_nh) {
  constexpr double kShortest_s = 0.05;
  constexpr double kLongest_s = 60.0;
  const double period_s = private_nh.param("diagnostic_period", 1.0);
  if (!std::isfinite(period_s)) return ros::WallDuration(1.0);
  return ros::WallDuration(std::clamp(period_s, kShortest_s, kLongest_s));
}

const char* hintFor(TrackingReason reason) {
  if (reason != TrackingReason::kStampNotNewer) return "";
  return "; two publishers of one topic, or stamps that have jumped back: see on_time_jump";
}

bool expectsMasks(const NodeParameters& parameters) {
  return expectsMask(parameters, 0) || expectsMask(parameters, 1);
}

}  // namespace

StereoOdometryNodelet::~StereoOdometryNodelet() { stop(); }

/// Ends whatever start() has begun, if only in part. The manager frees the queues of a nodelet that
/// does not start before the nodelet: nothing may be in them then.
void StereoOdometryNodelet::stop() {
  diagnostics_timer_.stop();
  for (ros::ServiceServer& service : services_) service.shutdown();
  doctor_.reset();
  reconfiguration_.reset();
  subscriber_.reset();
  mask_subscribers_.clear();
  if (queue_) queue_->stop();
  if (worker_.joinable()) worker_.join();  // it may subscribe to these until then
  prior_inputs_.reset();
  services_.clear();
  recorder_.reset();
  publishers_.reset();
  diagnostics_.reset();
  tf_listener_.reset();
}

void StereoOdometryNodelet::onInit() {
  try {
    start(loadNodeParameters(getPrivateNodeHandle()));
  } catch (const std::exception& error) {
    NODELET_FATAL("%s does not start: %s", getName().c_str(), error.what());
    stop();
    throw;
  }
}

void StereoOdometryNodelet::start(const AllParameters& parameters) {
  const ros::NodeHandle& nh = getNodeHandle();
  const ros::NodeHandle& private_nh = getPrivateNodeHandle();
  parameters_ = parameters.node;
  publishRemappings(nh, private_nh);
  budget_ = AdaptiveFeatureBudget(parameters_.target_frame_time_ms);
  tf_listener_ = std::make_unique<tf2_ros::TransformListener>(tf_buffer_, nh);
  publishers_ = std::make_unique<Publishers>(nh, parameters_);
  diagnostics_ = std::make_unique<Diagnostics>(nh, private_nh, parameters_, getName());
  processor_ = std::make_unique<FrameProcessor>(parameters);
  startRecorder();
  masks_ = std::make_unique<MaskBuffer>(parameters_);
  prior_inputs_ = std::make_unique<PriorInputs>(nh, getName(), parameters_, tf_buffer_, look_up_);
  prior_inputs_->enable(parameters.core);
  const auto queue_size = static_cast<std::size_t>(parameters_.queue_size);
  const std::size_t without_masks =
      expectsMasks(parameters_) ? pairsWhile(parameters_.mask_wait_s) : 0;
  queue_ = std::make_unique<FrameQueue<QueuedMessages>>(queue_size, queue_size + without_masks,
                                                        [this] { diagnostics_->noteDropped(); });
  worker_ = std::thread(&StereoOdometryNodelet::work, this);
  offerServices();
  // In the queue of all other callbacks: the thread that runs one of them may release the nodelet
  // last, when the manager has freed its other queue.
  reconfiguration_ = std::make_unique<Reconfiguration>(
      private_nh, parameters.core, [this](const Parameters& core) {
        const std::lock_guard<std::mutex> lock(request_mutex_);
        requested_parameters_ = core;
      });
  mask_subscribers_ = subscribeToMasks(nh, parameters_, masks_.get());
  subscriber_ = std::make_unique<StereoSubscriber>(
      nh, private_nh, parameters_, [this](const StereoMessages& m) { takeMessages(m); },
      [this](const std::string& text) { diagnostics_->noteRejectedStamp(text); });
  doctor_ =
      std::make_unique<Doctor>(nh, parameters_, getName(),
                               Doctor::Sources{subscriber_.get(), &tf_buffer_, diagnostics_.get()});
  diagnostics_timer_ = getNodeHandle().createWallTimer(
      diagnosticsPeriod(private_nh),
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
  if (!paused_) queue_->push({messages, ros::WallTime::now()});
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
    const Eigen::Isometry3d T_odom_base = toIsometry(request.pose);
    constexpr double kFarthest_m = 1e6;  // as initial_pose
    if (T_odom_base.translation().cwiseAbs().maxCoeff() > kFarthest_m)
      throw MessageError("the position is farther than 1000 km from the origin");
    requestPose(T_odom_base);
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
  const auto ready = [this](const QueuedMessages& queued) { return isReady(queued); };
  const auto retry = expectsMasks(parameters_) ? kMaskRetry : kTransformRetry;
  while (const auto queued = queue_->popWhen(ready, retry)) {
    processSafely(masks_->withMasks(queued->messages));
  }
}

bool StereoOdometryNodelet::isReady(const QueuedMessages& queued) {
  const double waited_s = (ros::WallTime::now() - queued.received).toSec();
  return masks_->isReady(queued.messages, waited_s) && knowsMounting(queued.messages);
}

/// An exception that left this thread would end every nodelet of the manager.
void StereoOdometryNodelet::processSafely(const StereoMessages& messages) {
  try {
    processAndPublish(messages);
  } catch (const MessageError& error) {
    diagnostics_->noteRejected(error.what());
    if (log_throttle_.passes("frame rejected")) {
      NODELET_ERROR("frame rejected: %s", error.what());
    }
  } catch (const std::exception& error) {
    diagnostics_->noteException(error.what());
    if (log_throttle_.passes("frame skipped after an exception")) {
      NODELET_ERROR("frame skipped after an exception: %s", error.what());
    }
  } catch (...) {
    diagnostics_->noteException("of an unknown type");
    if (log_throttle_.passes("frame skipped after an exception")) {
      NODELET_ERROR("frame skipped after an exception of an unknown type");
    }
  }
}

void StereoOdometryNodelet::processAndPublish(const StereoMessages& messages) {
  applyRequests();
  processor_->announce(toNanoseconds(messages.left->header.stamp));
  takePriors(messages.left->header.stamp);
  const auto begin = StageTimer::Clock::now();  // fewer features shorten no wait for samples
  const Eigen::Isometry3d T_base_header = mounting_.take(messages.left->header.frame_id);
  ProcessedFrame frame = processor_->process(messages, T_base_header);
  frame.T_guess_base = prior_inputs_->T_guess_base();
  if (frame.result.accepted()) recorder_->add(messages, frame);
  if (processor_->wasReset()) {
    NODELET_WARN("stamps jumped back: the odometry is reset to initial_pose");
    publishers_->clear();
  }
  if (!frame.result.accepted()) {
    if (log_throttle_.passes("frame dropped")) {
      NODELET_WARN("frame dropped: %s%s", toString(frame.result.reason),
                   hintFor(frame.result.reason));
    }
  }
  const double latency_ms = latencyMs(frame.header.stamp, ros::Time::now());
  diagnostics_->noteFrame(frame, latency_ms);
  if (frame.result.reason == TrackingReason::kException) {
    diagnostics_->noteException(frame.result.error);
    if (log_throttle_.passes("motion predicted after an exception")) {
      NODELET_ERROR("motion predicted after an exception: %s", frame.result.error.c_str());
    }
  }
  publishers_->publish(frame, diagnostics_->counters(), latency_ms);
  if (frame.result.processed()) {
    processor_->setFeatureBudget(
        budget_.addFrame(StageTimer::elapsedMs(begin), frame.result.by_landmarks));
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
  if (parameters) {
    processor_->setParameters(*parameters);
    prior_inputs_->enable(*parameters);
  }
  if (!pose) return;
  processor_->reset(*pose);
  publishers_->clear();
}

/// Looks up the pose of the camera in the base without waiting; it is never assumed.
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
        "; publish it with static_transform_publisher or set base_frame_id to " +
        (camera.empty() ? "the camera's frame"
                        : topmostFrame(tf_buffer_, camera, parameters_.odom_frame_id));
    diagnostics_->noteWaitingForTransform(text);
    if (log_throttle_.passes("frames wait")) {
      NODELET_WARN("frames wait: %s (%s)", text.c_str(), error.what());
    }
    return false;
  }
}

void StereoOdometryNodelet::takePriors(const ros::Time& stamp) {
  PriorSources& sources = processor_->priorSources();
  prior_inputs_->takeUntil(stamp, &sources);
  diagnostics_->noteImu(prior_inputs_->imuFacts(sources));
  diagnostics_->noteWheels(prior_inputs_->wheelFacts(sources));
}

Eigen::Isometry3d StereoOdometryNodelet::lookUpMounting(const std::string& sensor) const {
  if (sensor == parameters_.base_frame_id) return Eigen::Isometry3d::Identity();
  return toIsometry(
      tf_buffer_.lookupTransform(parameters_.base_frame_id, sensor, ros::Time(0)).transform);
}

}  // namespace point_line_odometry

PLUGINLIB_EXPORT_CLASS(point_line_odometry::StereoOdometryNodelet, nodelet::Nodelet)
