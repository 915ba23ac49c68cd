#pragma once

#include <nodelet/nodelet.h>
#include <point_line_odometry/ResetToPose.h>
#include <ros/service_server.h>
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
#include <vector>

#include "odometry/compute_governor.h"
#include "ros/camera_mounting.h"
#include "ros/diagnostics.h"
#include "ros/doctor.h"
#include "ros/flight_recorder.h"
#include "ros/frame_processor.h"
#include "ros/frame_queue.h"
#include "ros/node_parameters.h"
#include "ros/publishers.h"
#include "ros/reconfiguration.h"
#include "ros/stereo_subscriber.h"

namespace point_line_odometry {

/// Stereo odometry as a nodelet. Callbacks only put messages and requests aside; one worker thread
/// takes a set of messages after the other, processes and publishes it. Requests (reset, pause,
/// other parameters) take effect between two frames.
class StereoOdometryNodelet : public nodelet::Nodelet {
 public:
  StereoOdometryNodelet() = default;

  /// Returns when the worker has finished its frame.
  ~StereoOdometryNodelet() override;

 private:
  using Trigger = std_srvs::Trigger;

  void onInit() override;
  void start(const AllParameters& parameters);
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
  bool knowsMounting(const StereoMessages& messages);
  Eigen::Isometry3d lookUpMounting(const std::string& camera) const;

  NodeParameters parameters_;
  std::atomic<bool> paused_{false};
  std::mutex request_mutex_;
  std::optional<Eigen::Isometry3d> requested_T_odom_base_;
  std::optional<Parameters> requested_parameters_;

  // Used by the worker only, once it runs.
  CameraMounting mounting_{[this](const std::string& camera) { return lookUpMounting(camera); }};
  ComputeGovernor governor_{0.0};

  tf2_ros::Buffer tf_buffer_;
  std::unique_ptr<tf2_ros::TransformListener> tf_listener_;
  std::unique_ptr<Publishers> publishers_;
  std::unique_ptr<Diagnostics> diagnostics_;
  std::unique_ptr<FlightRecorder> recorder_;
  std::unique_ptr<FrameProcessor> processor_;
  std::unique_ptr<FrameQueue<StereoMessages>> queue_;
  std::thread worker_;
  std::unique_ptr<StereoSubscriber> subscriber_;
  std::unique_ptr<Doctor> doctor_;
  std::unique_ptr<Reconfiguration> reconfiguration_;
  std::vector<ros::ServiceServer> services_;
  ros::WallTimer diagnostics_timer_;
};

}  // namespace point_line_odometry
