#pragma once

#include <image_transport/publisher.h>
#include <nav_msgs/Odometry.h>
#include <nodelet/nodelet.h>
#include <ros/publisher.h>
#include <ros/subscriber.h>

#include <array>
#include <chrono>
#include <condition_variable>
#include <functional>
#include <limits>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>

#include "ros/camera_messages.h"
#include "ros/ground_truth_publisher.h"
#include "ros/log_throttle.h"
#include "ros/played_camera.h"
#include "ros/synthetic_stereo_parameters.h"
#include "world/synthetic_world.h"

namespace point_line_odometry {

/// The synthetic world as a stereo camera: a driver without a device, with ground truth.
///
/// In real time (the default) stamps are wall time, and frames that the computer is too slow to
/// render are skipped. With `publish_clock` the node is the source of simulated time: no frame is
/// skipped, and the clock waits for it. Images are rendered only while they have subscribers; time
/// and motion go on regardless. Messages are published as shared pointers and not written to
/// afterwards, so that nodelets of the same manager get them without a copy.
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
    ros::Publisher masks;  // if there are some
    std::string frame;
    std::string info_frame;
    ros::Duration stamp_offset;
  };

  void onInit() override;
  void start(const SyntheticStereoParameters& parameters);
  void advertise();
  void advertiseAs(const PlayedCamera& played);
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
                     const cv::Mat* image, const cv::Mat* mask, const ros::Time& stamp);
  void publishImu(std::size_t frame);
  void publishWheels(std::size_t frame);
  void publishClock(const ros::Time& time);
  bool somebodyWantsImages() const;
  void finish();

  bool waitUntilDue(std::int64_t stamp_ns);
  bool waitForAnswer();
  bool sleepUntil(Clock::time_point time);
  ros::Time toRosTime(std::int64_t stamp_ns) const;

  SyntheticStereoParameters parameters_;
  std::optional<PlayedCamera> played_;
  CameraFrameNames names_;
  std::unique_ptr<SyntheticWorld> world_;
  ros::Publisher static_transforms_;
  std::unique_ptr<GroundTruthPublisher> ground_truth_;
  std::array<Camera, 2> cameras_;
  ros::Publisher clock_;
  ros::Publisher imu_;
  std::function<ImuSample()> next_imu_;
  std::int64_t last_imu_ns_ = std::numeric_limits<std::int64_t>::min();
  ros::Publisher wheels_;
  std::function<OdometrySample()> next_wheels_;
  std::optional<OdometrySample> last_wheels_;
  ros::Subscriber answers_;

  // Used by the worker only.
  ros::Time time_of_first_frame_;
  Clock::time_point due_;  // when the last published frame was due
  std::int64_t last_stamp_ns_ = 0;
  std::optional<ros::Time> unanswered_;
  std::size_t num_skipped_ = 0;
  LogThrottle log_throttle_;

  std::mutex mutex_;  // guards what follows
  std::condition_variable changed_;
  bool stopped_ = false;
  ros::Time last_answer_;

  std::thread worker_;
};

}  // namespace point_line_odometry
