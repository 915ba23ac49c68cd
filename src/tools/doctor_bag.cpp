#include "tools/doctor_bag.h"

#include <ros/names.h>
#include <rosbag/view.h>
#include <tf2_msgs/TFMessage.h>

#include "common/input_error.h"
#include "ros/conversions.h"
#include "ros/sample_input.h"
#include "tools/interruption.h"

namespace point_line_odometry {
namespace {

void add(const rosbag::MessageInstance& message, const StereoInput::TopicNames& names,
         double time_s, StereoInput* input) {
  for (const StereoTopic topic : {kLeftImage, kRightImage, kLeftInfo, kRightInfo}) {
    if (message.getTopic() != names[topic]) continue;
    if (const auto image = message.instantiate<sensor_msgs::Image>()) {
      input->addImage(topic, image, time_s);
    } else if (const auto info = message.instantiate<sensor_msgs::CameraInfo>()) {
      input->addInfo(topic, info, time_s);
    }
  }
}

}  // namespace

DoctorBag::DoctorBag(const std::string& file) : bag_(file), tf_(ros::Duration(3600.0)) {}

StereoTopics DoctorBag::findTopics(const StereoTopics& named, const std::string& name_space,
                                   bool rectify) const {
  if (!named.left.empty() || !named.right.empty()) return bag_.chooseTopics(named);
  const std::set<std::string>& images = bag_.topics().images;
  const std::string prefix = ros::names::clean("/" + name_space + "/") + "/";
  const auto topics = [&](bool raw) {
    return StereoTopics{prefix + stereoTopicName(kLeftImage, raw),
                        prefix + stereoTopicName(kRightImage, raw)};
  };
  const auto has = [&](const StereoTopics& pair) {
    return images.count(pair.left) > 0 && images.count(pair.right) > 0;
  };
  if (!rectify && has(topics(false))) return topics(false);
  if (has(topics(true))) return topics(true);
  try {
    return findStereoTopics(images);
  } catch (const InputError&) {
    const bool raw =
        rectify || images.count(topics(true).left) > 0 || images.count(topics(true).right) > 0;
    return topics(raw);
  }
}

std::vector<std::string> DoctorBag::imageTopics() const {
  const InputBag::Topics& topics = bag_.topics();
  std::vector<std::string> names(topics.images.begin(), topics.images.end());
  names.insert(names.end(), topics.compressed_images.begin(), topics.compressed_images.end());
  return names;
}

InputFacts DoctorBag::read(const StereoTopics& topics, const NodeParameters& parameters,
                           double seconds, const TakeSet& take) {
  const StereoInput::TopicNames names{topics.left, topics.right, cameraInfoTopic(topics.left),
                                      cameraInfoTopic(topics.right)};
  ros::Time now;
  StereoInput input(
      parameters, names, [&](const StereoMessages& set) { take(set, now.toSec()); }, nullptr,
      [&] { return now; });
  bag_.guarded([&] {
    const auto images = bag_.view({topics.left, topics.right});
    if (images->size() > 0) {
      begin_ = images->getBeginTime();
      end_ = begin_ + ros::Duration(seconds);
    }
    readTransforms(end_);
    const auto camera = bag_.view({names.begin(), names.end()});
    for (const rosbag::MessageInstance& message : *camera) {
      throwIfInterrupted();
      if (message.getTime() > end_) break;
      now = message.getTime();
      add(message, names, now.toSec(), &input);
    }
  });
  return input.facts(now.toSec());
}

std::string DoctorBag::maskImages(const StereoTopics& topics) const {
  const std::set<std::string>& images = bag_.topics().images;
  const bool left = images.count(maskTopic(topics.left)) > 0;
  const bool right = images.count(maskTopic(topics.right)) > 0;
  if (left && right) return "both";
  if (left || right) return left ? "left" : "right";
  return "none";
}

void DoctorBag::readMasks(const StereoTopics& topics, const std::set<ros::Time>& stamps,
                          MaskBuffer* masks) const {
  const std::vector<std::string> names{maskTopic(topics.left), maskTopic(topics.right)};
  bag_.guarded([&] {
    const auto view = bag_.view(names);
    for (const rosbag::MessageInstance& message : *view) {
      throwIfInterrupted();
      const auto mask = message.instantiate<sensor_msgs::Image>();
      if (!mask || stamps.count(mask->header.stamp) == 0) continue;
      masks->add(message.getTopic() == names[0] ? 0 : 1, mask);
    }
  });
}

ImuCheckFacts DoctorBag::readImu(const std::string& topic) const {
  ImuCheckFacts facts;
  facts.topic = topic;
  bag_.guarded([&] {
    const auto view = bag_.view({topic});
    for (const rosbag::MessageInstance& message : *view) {
      throwIfInterrupted();
      constexpr double kMargin_s = 1.0;
      const double time_s = message.getTime().toSec();
      if (time_s < begin_.toSec() - kMargin_s) continue;
      if (time_s > end_.toSec() + kMargin_s) break;
      const auto imu = message.instantiate<sensor_msgs::Imu>();
      if (!imu) continue;
      facts.frame = withoutLeadingSlash(imu->header.frame_id);
      facts.samples.push_back(toSample(*imu).sample);
    }
  });
  return facts;
}

void DoctorBag::readTransforms(const ros::Time& end) {
  for (const char* topic : {"/tf_static", "/tf"}) {
    const bool is_static = std::string(topic) == "/tf_static";
    const auto view = bag_.view({topic});
    for (const rosbag::MessageInstance& message : *view) {
      const auto transforms = message.instantiate<tf2_msgs::TFMessage>();
      if (!transforms || (!is_static && message.getTime() > end)) continue;
      for (const auto& transform : transforms->transforms) {
        tf_.setTransform(transform, "bag", is_static);
      }
    }
  }
}

}  // namespace point_line_odometry
