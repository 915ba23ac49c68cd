#include "ros/stereo_subscriber.h"

#include <image_transport/image_transport.h>

#include <string>
#include <utility>

#include "ros/remapped_names.h"

namespace point_line_odometry {
namespace {

double wallSeconds() { return ros::WallTime::now().toSec(); }

StereoInput::TopicNames resolvedNames(const ros::NodeHandle& nh, bool rectify) {
  StereoInput::TopicNames names;
  for (std::size_t i = 0; i < kNumStereoTopics; ++i) {
    names[i] = nh.resolveName(stereoTopicName(static_cast<StereoTopic>(i), rectify));
  }
  return names;
}

}  // namespace

StereoSubscriber::StereoSubscriber(const ros::NodeHandle& nh, const ros::NodeHandle& private_nh,
                                   const NodeParameters& parameters, StereoInput::Callback callback,
                                   StereoInput::RejectionCallback rejected)
    : parameters_(parameters),
      last_set_s_(wallSeconds()),
      input_(
          parameters, resolvedNames(nh, parameters.rectify),
          [this, callback = std::move(callback)](const StereoMessages& set) {
            last_set_s_ = wallSeconds();
            callback(set);
          },
          std::move(rejected)) {
  subscribe(nh, private_nh);
}

void StereoSubscriber::subscribe(ros::NodeHandle nh, const ros::NodeHandle& private_nh) {
  const std::uint32_t queue_size = stereoQueueSize(parameters_);
  image_transport::ImageTransport transport(nh);
  const image_transport::TransportHints hints(parameters_.image_transport,
                                              ros::TransportHints().tcpNoDelay(), private_nh);
  for (const StereoTopic topic : {kLeftImage, kRightImage}) {
    const std::string name = stereoTopicName(topic, parameters_.rectify);
    image_subscribers_[topic] = transport.subscribe(
        nameForTransport(nh, name, parameters_.image_transport), queue_size,
        [this, topic](const sensor_msgs::ImageConstPtr& message) {
          input_.addImage(topic, message, wallSeconds());
        },
        {}, hints);
  }
  for (const StereoTopic topic : {kLeftInfo, kRightInfo}) {
    const boost::function<void(const sensor_msgs::CameraInfoConstPtr&)> take =
        [this, topic](const sensor_msgs::CameraInfoConstPtr& message) {
          input_.addInfo(topic, message, wallSeconds());
        };
    info_subscribers_[topic - kLeftInfo] =
        nh.subscribe(stereoTopicName(topic, parameters_.rectify), queue_size, take);
  }
}

InputFacts StereoSubscriber::facts() const {
  InputFacts facts = input_.facts(wallSeconds());
  for (std::size_t i = 0; i < image_subscribers_.size(); ++i) {
    facts.topics[i].publishers = static_cast<int>(image_subscribers_[i].getNumPublishers());
    facts.topics[kLeftInfo + i].publishers =
        static_cast<int>(info_subscribers_[i].getNumPublishers());
  }
  return facts;
}

double StereoSubscriber::secondsSinceSet() const { return wallSeconds() - last_set_s_; }

}  // namespace point_line_odometry
