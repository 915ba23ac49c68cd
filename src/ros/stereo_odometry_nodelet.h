#pragma once

#include <nodelet/nodelet.h>
#include <point_line_odometry/ResetToPose.h>
#include <ros/service_server.h>
#include <ros/subscriber.h>
#include <ros/wall_timer.h>
#include <std_srvs/Trigger.h>
#include <tf2_ros/buffer.h>
#include <tf2_ros/transform_listener.h>

#include <Eigen/Geometry>
#include <atomic>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "odometry/adaptive_feature_budget.h"
#include "ros/diagnostics.h"
#include "ros/doctor.h"
#include "ros/flight_recorder.h"
#include "ros/frame_processor.h"
#include "ros/frame_queue.h"
#include "ros/log_throttle.h"
#include "ros/mask_buffer.h"
#include "ros/node_parameters.h"
#include "ros/prior_inputs.h"
#include "ros/publishers.h"
#include "ros/reconfiguration.h"
#include "ros/sensor_mounting.h"
#include "ros/stereo_subscriber.h"

namespace point_line_odometry {

/// Stereo odometry as a nodelet. Callbacks only queue messages and requests; one worker thread
/// processes the sets of messages and publishes the results. Requests (reset, pause, other
/// parameters) take effect between two frames.
class StereoOdometryNodelet : public nodelet::Nodelet {
 public:
  StereoOdometryNodelet() = default;

  /// Returns when the worker has finished its frame.
  ~StereoOdometryNodelet() override;

 private:
  using Trigger = std_srvs::Trigger;

  struct QueuedMessages {
    StereoMessages messages;
    ros::WallTime received;
  };

  void onInit() override;
  void start(const AllParameters& parameters);
  void stop();
  void offerServices();
  void startRecorder();

  void takeMessages(const StereoMessages& messages);
  bool reset(Trigger::Request& request, Trigger::Response& response);
  bool resetToPose(ResetToPose::Request& request, ResetToPose::Response& response);
  bool pause(Trigger::Request& request, Trigger::Response& response);
  bool resume(Trigger::Request& request, Trigger::Response& response);
  void requestPose(const Eigen::Isometry3d& T_odom_base);

  void work();
  void processSafely(const StereoMessages& messages);
  void processAndPublish(const StereoMessages& messages);
  void applyRequests();
  bool isReady(const QueuedMessages& queued);
  bool knowsMounting(const StereoMessages& messages);
  void takePriors(const ros::Time& stamp);
  Eigen::Isometry3d lookUpMounting(const std::string& sensor) const;

  NodeParameters parameters_;
  LogThrottle log_throttle_;
  std::atomic<bool> paused_{false};
  std::mutex request_mutex_;
  std::optional<Eigen::Isometry3d> requested_T_odom_base_;
  std::optional<Parameters> requested_parameters_;

  // Used by the worker only, once it runs.
  const SensorMounting::Lookup look_up_{
      [this](const std::string& sensor) { return lookUpMounting(sensor); }};
  SensorMounting mounting_{"left image", look_up_};
  AdaptiveFeatureBudget budget_{0.0};

  tf2_ros::Buffer tf_buffer_;
  std::unique_ptr<tf2_ros::TransformListener> tf_listener_;
  std::unique_ptr<Publishers> publishers_;
  std::unique_ptr<Diagnostics> diagnostics_;
  std::unique_ptr<FlightRecorder> recorder_;
  std::unique_ptr<FrameProcessor> processor_;
  std::unique_ptr<MaskBuffer> masks_;
  std::unique_ptr<FrameQueue<QueuedMessages>> queue_;
  std::unique_ptr<PriorInputs> prior_inputs_;
  std::thread worker_;
  std::vector<ros::Subscriber> mask_subscribers_;
  std::unique_ptr<StereoSubscriber> subscriber_;
  std::unique_ptr<Doctor> doctor_;
  std::unique_ptr<Reconfiguration> reconfiguration_;
  std::vector<ros::ServiceServer> services_;
  ros::WallTimer diagnostics_timer_;
};

}  // namespace point_line_odometry
