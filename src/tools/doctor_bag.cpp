#include "tools/doctor_bag.h"

#include <console_bridge/console.h>
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

DoctorBag::DoctorBag(const std::string& file) : file_(file), tf_(ros::Duration(3600.0)) {
  guarded([&] {
    // The bag library logs faults before it throws them; the exception reports them once.
    console_bridge::noOutputHandler();
    bag_.open(file_, rosbag::bagmode::Read);
    rosbag::View all(bag_);
    for (const rosbag::ConnectionInfo* connection : all.getConnections()) {
      const std::string& type = connection->datatype;
      if (type == "sensor_msgs/Image") images_.insert(connection->topic);
      if (type == "sensor_msgs/Imu") imus_.insert(connection->topic);
      if (type == "sensor_msgs/CompressedImage") compressed_.insert(connection->topic);
    }
  });
}

StereoTopics DoctorBag::findTopics(const std::string& name_space, bool rectify) const {
  const std::string prefix = ros::names::clean("/" + name_space + "/") + "/";
  const auto topics = [&](bool raw) {
    return StereoTopics{prefix + stereoTopicName(kLeftImage, raw),
                        prefix + stereoTopicName(kRightImage, raw)};
  };
  const auto has = [&](const StereoTopics& pair) {
    return images_.count(pair.left) > 0 && images_.count(pair.right) > 0;
  };
  if (!rectify && has(topics(false))) return topics(false);
  if (has(topics(true))) return topics(true);
  try {
    return findStereoTopics(images_);
  } catch (const InputError&) {
    const bool raw =
        rectify || images_.count(topics(true).left) > 0 || images_.count(topics(true).right) > 0;
    return topics(raw);
  }
}

std::vector<std::string> DoctorBag::imageTopics() const {
  std::vector<std::string> names(images_.begin(), images_.end());
  names.insert(names.end(), compressed_.begin(), compressed_.end());
  return names;
}

InputFacts DoctorBag::read(const StereoTopics& topics, const NodeParameters& parameters,
                           double seconds, const TakeSet& take) {
  const StereoInput::TopicNames names{topics.left, topics.right, cameraInfoTopic(topics.left),
                                      cameraInfoTopic(topics.right)};
  double now_s = 0.0;
  StereoInput input(parameters, names, [&](const StereoMessages& set) { take(set, now_s); });
  guarded([&] {
    const std::vector<std::string> of_camera(names.begin(), names.end());
    rosbag::View camera(bag_, rosbag::TopicQuery(of_camera));
    const ros::Time end =
        camera.size() == 0 ? ros::TIME_MAX : camera.getBeginTime() + ros::Duration(seconds);
    readTransforms(end);
    if (camera.size() > 0) begin_ = camera.getBeginTime();
    end_ = end;
    for (const rosbag::MessageInstance& message : camera) {
      throwIfInterrupted();
      if (message.getTime() > end) break;
      now_s = message.getTime().toSec();
      add(message, names, now_s, &input);
    }
  });
  return input.facts(now_s);
}

std::string DoctorBag::findImu(const StereoTopics& topics) const {
  std::string beside = ros::names::clean(
      ros::names::parentNamespace(ros::names::parentNamespace(topics.left)) + "/imu");
  if (imus_.count(beside) > 0) return beside;
  return imus_.size() == 1 ? *imus_.begin() : "";
}

ImuCheckFacts DoctorBag::readImu(const std::string& topic) const {
  ImuCheckFacts facts;
  facts.topic = topic;
  guarded([&] {
    rosbag::View view(bag_, rosbag::TopicQuery(topic));
    for (const rosbag::MessageInstance& message : view) {
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

void DoctorBag::guarded(const std::function<void()>& step) const {
  try {
    step();
  } catch (const rosbag::BagUnindexedException&) {
    throw InputError("bag '" + file_ + "' was not closed: repair it with 'rosbag reindex'");
  } catch (const ros::Exception& error) {
    throw InputError("bag '" + file_ + "' cannot be read (" + error.what() +
                     "): it is cut off, damaged or no bag; try 'rosbag reindex'");
  }
}

void DoctorBag::readTransforms(const ros::Time& end) {
  for (const char* topic : {"/tf_static", "/tf"}) {
    const bool is_static = std::string(topic) == "/tf_static";
    rosbag::View view(bag_, rosbag::TopicQuery(topic));
    for (const rosbag::MessageInstance& message : view) {
      const auto transforms = message.instantiate<tf2_msgs::TFMessage>();
      if (!transforms || (!is_static && message.getTime() > end)) continue;
      for (const auto& transform : transforms->transforms) {
        tf_.setTransform(transform, file_, is_static);
      }
    }
  }
}

}  // namespace point_line_odometry
