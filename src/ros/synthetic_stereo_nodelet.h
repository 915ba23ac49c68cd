#pragma once

#include <image_transport/publisher.h>
#include <nav_msgs/Odometry.h>
#include <nodelet/nodelet.h>
#include <ros/publisher.h>
#include <ros/subscriber.h>
#include <tf2_ros/static_transform_broadcaster.h>

#include <array>
#include <chrono>
#include <condition_variable>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>

#include "point_line_odometry/synthetic_world.h"
#include "ros/camera_messages.h"
#include "ros/ground_truth_publisher.h"
#include "ros/synthetic_stereo_parameters.h"

namespace point_line_odometry {

/// The synthetic world as a stereo camera: a driver that needs no device and knows the true motion.
///
/// In real time (the default) stamps are wall time, and what the computer is too slow to render is
/// skipped, as a camera does. With `publish_clock` the node is the source of simulated time: every
/// frame comes, and the clock waits for it. Images are rendered only while somebody listens to
/// them; time and motion go on all the same. Messages are published as shared pointers and never
/// touched again, so that nodelets of the same manager get them without a copy.
class SyntheticStereoNodelet : public nodelet::Nodelet {
 public:
  SyntheticStereoNodelet() = default;

  /// Returns when the worker has finished its frame.
  ~SyntheticStereoNodelet() override;

 private:
  using Clock = std::chrono::steady_clock;

  struct Camera {
    image_transport::Publisher images;
    ros::Publisher infos;
    std::string frame;
  };

  void onInit() override;
  void start(const SyntheticStereoParameters& parameters);
  void advertise();
  void takeAnswer(const nav_msgs::OdometryConstPtr& answer);

  void work();
  void run();
  bool waitToBegin();
  bool standStillUntil(Clock::time_point time);
  std::string missingListeners() const;
  bool showFrame(std::size_t frame);
  std::size_t nextFrame(std::size_t frame);
  void publish(std::size_t frame, const std::optional<StereoImages>& images);
  void publishCamera(const Camera& camera, const CameraCalibration& calibration,
                     const cv::Mat* image, const ros::Time& stamp);
  void publishClock(const ros::Time& time);
  bool somebodyWantsImages() const;
  void finish();

  bool waitUntilDue(std::int64_t stamp_ns);
  bool waitForAnswer();
  bool sleepUntil(Clock::time_point time);
  ros::Time toRosTime(std::int64_t stamp_ns) const;

  SyntheticStereoParameters parameters_;
  CameraFrameNames names_;
  std::unique_ptr<SyntheticWorld> world_;
  std::unique_ptr<tf2_ros::StaticTransformBroadcaster> broadcaster_;
  std::unique_ptr<GroundTruthPublisher> ground_truth_;
  std::array<Camera, 2> cameras_;
  ros::Publisher clock_;
  ros::Subscriber answers_;

  // Used by the worker only.
  ros::Time time_of_first_frame_;
  Clock::time_point due_;  // when the frame shown last was due
  std::int64_t last_stamp_ns_ = 0;
  std::optional<ros::Time> unanswered_;
  std::size_t num_skipped_ = 0;

  std::mutex mutex_;  // guards what follows
  std::condition_variable changed_;
  bool stopped_ = false;
  ros::Time last_answer_;

  std::thread worker_;
};

}  // namespace point_line_odometry
