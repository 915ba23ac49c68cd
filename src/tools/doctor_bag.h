#pragma once

#include <console_bridge/console.h>
#include <ros/names.h>
#include <rosbag/bag.h>
#include <rosbag/view.h>
#include <tf2/buffer_core.h>
#include <tf2/exceptions.h>
#include <tf2_msgs/TFMessage.h>

#include <functional>
#include <set>
#include <string>
#include <vector>

#include "ros/stereo_input.h"
#include "tools/bag_source.h"

namespace point_line_odometry {

/// A bag as the doctor sees it: whatever is wrong with its topics is for the report to say, only a
/// file that cannot be read is an error.
class DoctorBag {
 public:
  using TakeSet = std::function<void(const StereoMessages& set, double time_s)>;

  /// Throws InputError if the file cannot be read.
  explicit DoctorBag(const std::string& file) : file_(file), tf_(ros::Duration(3600.0)) {
    guarded([&] {
      // The bag library logs faults before it throws them; they are told once, by the exception.
      console_bridge::noOutputHandler();
      bag_.open(file_, rosbag::bagmode::Read);
      rosbag::View all(bag_);
      for (const rosbag::ConnectionInfo* connection : all.getConnections()) {
        const std::string& type = connection->datatype;
        if (type == "sensor_msgs/Image") images_.insert(connection->topic);
        if (type == "sensor_msgs/CompressedImage") compressed_.insert(connection->topic);
      }
    });
  }

  /// The only pair there is, or else the one that the nodelet would take.
  StereoTopics findTopics(const std::string& name_space, bool rectify) const {
    try {
      return findStereoTopics(images_);
    } catch (const InputError&) {
      const std::string prefix = ros::names::clean("/" + name_space + "/") + "/";
      const bool raw = rectify || images_.count(prefix + "left/image_raw") > 0 ||
                       images_.count(prefix + "right/image_raw") > 0;
      return {prefix + stereoTopicName(kLeftImage, raw),
              prefix + stereoTopicName(kRightImage, raw)};
    }
  }

  std::vector<std::string> imageTopics() const {
    std::vector<std::string> names(images_.begin(), images_.end());
    names.insert(names.end(), compressed_.begin(), compressed_.end());
    return names;
  }

  /// Reads `seconds` of the bag from the first message of these topics on, and all static
  /// transforms. \param take called with each complete set. Throws InputError if the bag is
  /// damaged.
  InputFacts read(const StereoTopics& topics, const NodeParameters& parameters, double seconds,
                  const TakeSet& take) {
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
      for (const rosbag::MessageInstance& message : camera) {
        throwIfInterrupted();
        if (message.getTime() > end) break;
        now_s = message.getTime().toSec();
        add(message, names, now_s, &input);
      }
    });
    return input.facts(now_s);
  }

  /// What read() has found.
  const tf2::BufferCore& transforms() const { return tf_; }

 private:
  template <typename Step>
  void guarded(const Step& step) {
    try {
      step();
    } catch (const rosbag::BagUnindexedException&) {
      throw InputError("bag '" + file_ + "' was not closed: repair it with 'rosbag reindex'");
    } catch (const ros::Exception& error) {
      throw InputError("bag '" + file_ + "' cannot be read (" + error.what() +
                       "): it is cut off, damaged or no bag; try 'rosbag reindex'");
    }
  }

  void readTransforms(const ros::Time& end) {
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

  static void add(const rosbag::MessageInstance& message, const StereoInput::TopicNames& names,
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

  const std::string file_;
  rosbag::Bag bag_;
  std::set<std::string> images_;
  std::set<std::string> compressed_;
  tf2::BufferCore tf_;
};

}  // namespace point_line_odometry
