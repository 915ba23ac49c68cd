#pragma once

#include <image_transport/subscriber.h>
#include <message_filters/sync_policies/approximate_time.h>
#include <message_filters/sync_policies/exact_time.h>
#include <message_filters/synchronizer.h>
#include <ros/node_handle.h>
#include <ros/subscriber.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Image.h>

#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <string>

#include "ros/frame_processor.h"
#include "ros/node_parameters.h"

namespace point_line_odometry {

/// Subscribes to the four topics of a stereo camera and hands over what belongs together: equal
/// stamps, or near ones with `approximate_sync`. Counts what arrives, so that it can say why
/// nothing comes together. The subscriptions end with it.
class StereoSubscriber {
 public:
  using Callback = std::function<void(const StereoMessages&)>;

  /// \param nh names are resolved here: left/image_rect, right/image_rect (image_raw with
  /// `rectify`), left/camera_info,
  ///        right/camera_info.
  /// \param private_nh where the image transports look up their own parameters.
  /// \param callback called from the callback queue of `nh`, never from two threads at once if that
  /// is a serial queue.
  StereoSubscriber(ros::NodeHandle nh, const ros::NodeHandle& private_nh,
                   const NodeParameters& parameters, Callback callback);

  StereoSubscriber(const StereoSubscriber&) = delete;
  StereoSubscriber& operator=(const StereoSubscriber&) = delete;

  /// Time since the last complete set [s] of wall time, or since the start.
  double silenceSeconds() const;

  /// One sentence: messages on each topic, what is missing, and what to do about it.
  std::string explainSilence() const;

  /// Complete sets so far.
  std::uint64_t numSets() const;

  /// Left images so far that did not become part of a set.
  std::uint64_t numUnpaired() const;

 private:
  enum Topic : std::size_t { kLeftImage, kRightImage, kLeftInfo, kRightInfo, kNumTopics };

  struct Arrivals {
    std::string name;
    std::uint64_t count = 0;
    std::uint64_t since_set = 0;  // of count, after the last complete set
    ros::Time last_stamp;         // zero: none since the last jump of the clock
  };

  using Image = sensor_msgs::Image;
  using Info = sensor_msgs::CameraInfo;
  using ExactPolicy = message_filters::sync_policies::ExactTime<Image, Image, Info, Info>;
  using NearPolicy = message_filters::sync_policies::ApproximateTime<Image, Image, Info, Info>;

  void subscribe(ros::NodeHandle nh, const ros::NodeHandle& private_nh);
  void makeSynchronizer();
  template <int topic, typename Message>
  void arrived(const boost::shared_ptr<const Message>& message);
  template <int topic, typename Message>
  void synchronise(const boost::shared_ptr<const Message>& message);
  bool noteArrival(std::size_t topic, const ros::Time& stamp);
  std::string silentTopics() const;
  std::uint64_t mostSinceSet() const;
  void completed(const sensor_msgs::ImageConstPtr& left, const sensor_msgs::ImageConstPtr& right,
                 const sensor_msgs::CameraInfoConstPtr& left_info,
                 const sensor_msgs::CameraInfoConstPtr& right_info);

  const NodeParameters parameters_;
  const Callback callback_;

  mutable std::mutex mutex_;  // guards what the report is made of
  std::array<Arrivals, kNumTopics> arrivals_;
  std::uint64_t num_sets_ = 0;
  ros::WallTime last_set_;

  std::unique_ptr<message_filters::Synchronizer<ExactPolicy>> exact_;
  std::unique_ptr<message_filters::Synchronizer<NearPolicy>> near_;
  std::array<image_transport::Subscriber, 2> image_subscribers_;
  std::array<ros::Subscriber, 2> info_subscribers_;
};

}  // namespace point_line_odometry
