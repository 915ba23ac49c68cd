#include "ros/stereo_subscriber.h"

#include <image_transport/image_transport.h>
#include <ros/console.h>

#include <algorithm>
#include <cmath>
#include <exception>
#include <sstream>
#include <utility>

namespace point_line_odometry {
namespace {

/// So many may have been on their way when everything stopped.
constexpr std::uint64_t kFewMessages = 3;

std::string imageName(const NodeParameters& parameters) {
  return parameters.rectify ? "image_raw" : "image_rect";
}

/// Messages of a topic that may wait for those of the others. Not fewer than these, or a pair would
/// miss one of its parts when messages come in bursts: whole pairs are dropped afterwards, where
/// they are counted.
std::uint32_t inputQueueSize(const NodeParameters& parameters) {
  constexpr int kShortestQueue = 10;
  return static_cast<std::uint32_t>(std::max(kShortestQueue, parameters.queue_size));
}

}  // namespace

StereoSubscriber::StereoSubscriber(ros::NodeHandle nh, const ros::NodeHandle& private_nh,
                                   const NodeParameters& parameters, Callback callback)
    : parameters_(parameters), callback_(std::move(callback)), last_set_(ros::WallTime::now()) {
  const std::string image = imageName(parameters_);
  arrivals_[kLeftImage].name = nh.resolveName("left/" + image);
  arrivals_[kRightImage].name = nh.resolveName("right/" + image);
  arrivals_[kLeftInfo].name = nh.resolveName("left/camera_info");
  arrivals_[kRightInfo].name = nh.resolveName("right/camera_info");
  makeSynchronizer();
  subscribe(nh, private_nh);
}

void StereoSubscriber::subscribe(ros::NodeHandle nh, const ros::NodeHandle& private_nh) {
  const std::uint32_t queue_size = inputQueueSize(parameters_);
  const std::string image = imageName(parameters_);
  // Names are remapped when they are subscribed to, except by the transports that add to them. A
  // name must not be remapped twice: that would undo an exchange of left and right.
  const bool remap_here = parameters_.image_transport != "raw";
  const auto topic = [&](const std::string& name) {
    return remap_here ? nh.resolveName(name) : name;
  };
  image_transport::ImageTransport transport(nh);
  const image_transport::TransportHints hints(parameters_.image_transport,
                                              ros::TransportHints().tcpNoDelay(), private_nh);
  image_subscribers_[0] = transport.subscribe(
      topic("left/" + image), queue_size,
      [this](const sensor_msgs::ImageConstPtr& m) { arrived<kLeftImage>(m); }, {}, hints);
  image_subscribers_[1] = transport.subscribe(
      topic("right/" + image), queue_size,
      [this](const sensor_msgs::ImageConstPtr& m) { arrived<kRightImage>(m); }, {}, hints);
  using InfoCallback = boost::function<void(const sensor_msgs::CameraInfoConstPtr&)>;
  const InfoCallback left_info = [this](const auto& m) { arrived<kLeftInfo>(m); };
  const InfoCallback right_info = [this](const auto& m) { arrived<kRightInfo>(m); };
  info_subscribers_[0] = nh.subscribe("left/camera_info", queue_size, left_info);
  info_subscribers_[1] = nh.subscribe("right/camera_info", queue_size, right_info);
}

void StereoSubscriber::makeSynchronizer() {
  const std::uint32_t queue_size = inputQueueSize(parameters_);
  exact_.reset();
  near_.reset();
  if (parameters_.approximate_sync) {
    near_ = std::make_unique<message_filters::Synchronizer<NearPolicy>>(NearPolicy(queue_size));
    near_->setMaxIntervalDuration(ros::Duration(parameters_.approximate_sync_max_interval_s));
    near_->registerCallback(&StereoSubscriber::completed, this);
  } else {
    exact_ = std::make_unique<message_filters::Synchronizer<ExactPolicy>>(ExactPolicy(queue_size));
    exact_->registerCallback(&StereoSubscriber::completed, this);
  }
}

/// An exception that left a callback would end every nodelet of the manager; differences of stamps
/// that are too long for a ros::Duration throw.
template <int topic, typename Message>
void StereoSubscriber::arrived(const boost::shared_ptr<const Message>& message) {
  const bool jumped_back = noteArrival(topic, message->header.stamp);
  try {
    if (jumped_back) makeSynchronizer();
    synchronise<topic>(message);
  } catch (const std::exception& error) {
    ROS_ERROR_THROTTLE(5.0,
                       "images and camera_infos that waited for their partners are dropped: %s",
                       error.what());
    makeSynchronizer();
  }
}

template <int topic, typename Message>
void StereoSubscriber::synchronise(const boost::shared_ptr<const Message>& message) {
  if (exact_) {
    exact_->template add<topic>(message);
  } else {
    near_->template add<topic>(message);
  }
}

/// Returns true if the clock has jumped back since the last message of this topic.
bool StereoSubscriber::noteArrival(std::size_t topic, const ros::Time& stamp) {
  const std::lock_guard<std::mutex> lock(mutex_);
  Arrivals& arrivals = arrivals_[topic];
  ++arrivals.count;
  ++arrivals.since_set;
  const bool jumped_back = arrivals.last_stamp.toSec() - stamp.toSec() > kMaxLateness_s;
  if (jumped_back) {
    for (Arrivals& other : arrivals_) other.last_stamp = ros::Time();
  }
  arrivals.last_stamp = stamp;
  return jumped_back;
}

void StereoSubscriber::completed(const sensor_msgs::ImageConstPtr& left,
                                 const sensor_msgs::ImageConstPtr& right,
                                 const sensor_msgs::CameraInfoConstPtr& left_info,
                                 const sensor_msgs::CameraInfoConstPtr& right_info) {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    ++num_sets_;
    for (Arrivals& topic : arrivals_) topic.since_set = 0;
    last_set_ = ros::WallTime::now();
  }
  callback_({left, right, left_info, right_info});
}

double StereoSubscriber::silenceSeconds() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  return (ros::WallTime::now() - last_set_).toSec();
}

std::uint64_t StereoSubscriber::numSets() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  return num_sets_;
}

std::uint64_t StereoSubscriber::numUnpaired() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  const std::uint64_t images = arrivals_[kLeftImage].count;
  return images > num_sets_ ? images - num_sets_ : 0;
}

/// Topics that nothing comes on while it does on others, or has ever come on.
std::string StereoSubscriber::silentTopics() const {
  std::string silent;
  for (const Arrivals& topic : arrivals_) {
    const bool stopped = topic.since_set == 0 && mostSinceSet() >= kFewMessages;
    if (topic.count == 0 || stopped) silent += (silent.empty() ? "" : " and ") + topic.name;
  }
  return silent;
}

/// Messages of the liveliest topic since the last complete set.
std::uint64_t StereoSubscriber::mostSinceSet() const {
  std::uint64_t most = 0;
  for (const Arrivals& topic : arrivals_) most = std::max(most, topic.since_set);
  return most;
}

std::string StereoSubscriber::explainSilence() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  std::ostringstream text;
  text.precision(3);
  text << "messages so far:";
  for (const Arrivals& topic : arrivals_) text << " " << topic.name << " " << topic.count << ",";
  const std::string missing = silentTopics();
  const bool all_stopped = num_sets_ > 0 && missing.empty() && mostSinceSet() < kFewMessages;
  text << " synchronised sets " << num_sets_ << "; ";
  const double skew_s = std::abs(arrivals_[kLeftImage].last_stamp.toSec() -
                                 arrivals_[kRightImage].last_stamp.toSec());
  if (!missing.empty()) {
    text << "nothing arrives on " << missing
         << (num_sets_ > 0 ? " any more: check the camera and its driver"
                           : ": check that it is published and that the names are remapped to it");
  } else if (all_stopped) {
    text << "the camera has stopped publishing, or the bag is paused or has ended";
  } else if (parameters_.approximate_sync) {
    text << "latest stamps of left and right differ by " << skew_s
         << " s: raise approximate_sync_max_interval_s above the difference of a pair, and check "
            "that image and camera_info carry the same stamp";
  } else {
    text << "latest stamps of left and right differ by " << skew_s
         << " s: trigger both cameras together, or set approximate_sync to true if that is small; "
            "image and camera_info must carry the same stamp";
  }
  return text.str();
}

}  // namespace point_line_odometry
