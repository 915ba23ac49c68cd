#pragma once

#include <message_filters/sync_policies/approximate_time.h>
#include <message_filters/sync_policies/exact_time.h>
#include <message_filters/synchronizer.h>
#include <ros/time.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Image.h>

#include <array>
#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>

#include "ros/frame_processor.h"
#include "ros/log_throttle.h"
#include "ros/node_parameters.h"
#include "ros/stamp_filter.h"

namespace point_line_odometry {

/// The four topics of a stereo camera.
enum StereoTopic : std::size_t { kLeftImage, kRightImage, kLeftInfo, kRightInfo, kNumStereoTopics };

/// Name of a topic below the camera's namespace, for example "left/image_rect".
std::string stereoTopicName(StereoTopic topic, bool rectify);

/// Queue size of a topic: messages that may wait for those of the other topics. Long enough for
/// bursts, so that only complete pairs are dropped, later, where they are counted.
std::uint32_t stereoQueueSize(const NodeParameters& parameters);

/// Messages received on one topic.
struct TopicFacts {
  std::string name;  ///< as resolved
  std::uint64_t messages = 0;
  double rate_hz = 0.0;           ///< of the latest arrivals; 0 for fewer than two
  double since_latest_s = 0.0;    ///< time since the latest arrival
  std::optional<int> publishers;  ///< nothing: not known, as in a bag
};

/// Messages received on all four topics, and their synchronisation.
struct InputFacts {
  std::array<TopicFacts, kNumStereoTopics> topics;
  std::uint64_t sets = 0;  ///< complete ones
  double set_rate_hz = 0.0;
  std::uint64_t unsynchronized = 0;    ///< left images that did not become part of a set
  bool unstamped = false;              ///< the latest image or camera_info of a topic has stamp 0
  std::optional<double> image_skew_s;  ///< median distance of a left stamp to the nearest right one
  std::optional<double> info_skew_s;   ///< the same from images to camera_infos, the larger of both
  StereoMessages latest;               ///< of each topic; null if there is none
  StereoMessages latest_set;           ///< all null before the first one
};

/// Synchronises the four topics by equal stamps, or near ones with `approximate_sync`. Messages
/// that StampFilter rejects are not used. Keeps statistics of what was received to explain why
/// there are no complete sets. Messages are added by one thread at a time; all other methods are
/// thread-safe.
class StereoInput {
 public:
  using Callback = std::function<void(const StereoMessages&)>;
  using TopicNames = std::array<std::string, kNumStereoTopics>;

  /// Called with the name of the topic and what is wrong with the stamp.
  using RejectionCallback = std::function<void(const std::string&)>;

  /// The time that stamps are compared with.
  using Clock = std::function<ros::Time()>;

  /// \param callback called with each complete set by the methods that add messages.
  /// \param rejected called by them for each message that is rejected for its stamp.
  /// \param clock of a bag; else ROS' time, which must be initialised.
  StereoInput(const NodeParameters& parameters, const TopicNames& names, Callback callback,
              RejectionCallback rejected = nullptr, Clock clock = ros::Time::now);

  StereoInput(const StereoInput&) = delete;
  StereoInput& operator=(const StereoInput&) = delete;

  /// \param arrival_s time of arrival, of any clock.
  void addImage(StereoTopic topic, const sensor_msgs::ImageConstPtr& message, double arrival_s);
  void addInfo(StereoTopic topic, const sensor_msgs::CameraInfoConstPtr& message, double arrival_s);

  /// At the end of all messages: completes the sets whose messages wait for later ones.
  void flush();

  /// Without `publishers`, which are not known here. \param now_s of the clock of the arrivals.
  InputFacts facts(double now_s) const;

  /// One sentence on why there are no complete sets: messages on each topic, what is missing, and
  /// what to do about it.
  std::string explainTimeout() const;

 private:
  struct Arrivals {
    std::string name;
    std::uint64_t count = 0;
    std::uint64_t since_set = 0;   // of count, after the last complete set
    std::deque<ros::Time> stamps;  // the latest, whatever they are
    std::deque<double> times_s;
  };

  using Image = sensor_msgs::Image;
  using Info = sensor_msgs::CameraInfo;
  using ExactPolicy = message_filters::sync_policies::ExactTime<Image, Image, Info, Info>;
  using NearPolicy = message_filters::sync_policies::ApproximateTime<Image, Image, Info, Info>;

  void makeSynchronizer();
  template <int topic, typename Message>
  void add(const boost::shared_ptr<const Message>& message, double arrival_s);
  template <int topic, typename Message>
  void synchronise(const boost::shared_ptr<const Message>& message);
  void follow(StereoTopic topic, const StampFilter::Decision& decision);
  void reject(StereoTopic topic, const StampFilter::Rejection& rejection);
  void noteArrival(StereoTopic topic, const ros::Time& stamp, double arrival_s);
  bool hasStopped(const Arrivals& topic) const;
  std::string missingTopics() const;
  std::uint64_t mostSinceSet() const;
  std::optional<double> skew(StereoTopic topic, StereoTopic other) const;
  void completed(const sensor_msgs::ImageConstPtr& left, const sensor_msgs::ImageConstPtr& right,
                 const sensor_msgs::CameraInfoConstPtr& left_info,
                 const sensor_msgs::CameraInfoConstPtr& right_info);

  const NodeParameters parameters_;
  const Callback callback_;
  const RejectionCallback rejected_;
  const Clock clock_;
  LogThrottle log_throttle_;

  mutable std::mutex mutex_;  // guards the members that facts() reads
  std::array<Arrivals, kNumStereoTopics> arrivals_;
  StereoMessages latest_;
  StereoMessages latest_set_;
  std::uint64_t num_sets_ = 0;
  std::deque<double> set_times_s_;
  std::uint64_t rejected_since_set_ = 0;
  std::string last_rejection_;

  std::array<StampFilter, kNumStereoTopics> filters_;
  std::array<bool, kNumStereoTopics>
      waiting_{};     // topics with messages in the synchroniser's queue
  ros::Time newest_;  // of those that passed
  bool flushing_ = false;
  std::unique_ptr<message_filters::Synchronizer<ExactPolicy>> exact_;
  std::unique_ptr<message_filters::Synchronizer<NearPolicy>> near_;
};

}  // namespace point_line_odometry
