#include "tools/input_bag.h"

#include <console_bridge/console.h>
#include <ros/console.h>
#include <ros/names.h>

#include <filesystem>
#include <memory>
#include <system_error>
#include <utility>

#include "ros/conversions.h"

namespace point_line_odometry {

InputBag::InputBag(std::string file) : file_(std::move(file)) {
  std::error_code ignored;
  if (!std::filesystem::is_regular_file(file_, ignored))
    throw InputError("bag '" + file_ + "' does not exist, or is no file: check the path");
  guarded([this] {
    // What is wrong with a bag and its messages is said once: by exceptions, warnings and reports.
    console_bridge::noOutputHandler();
    ros::Time::init();  // for the log
    ros::console::set_logger_level(ROSCONSOLE_DEFAULT_NAME, ros::console::levels::Error);
    bag_.open(file_, rosbag::bagmode::Read);
    rosbag::View all(bag_);
    for (const rosbag::ConnectionInfo* connection : all.getConnections()) {
      const std::string& type = connection->datatype;
      if (type == "sensor_msgs/Image") topics_.images.insert(connection->topic);
      if (type == "sensor_msgs/CompressedImage")
        topics_.compressed_images.insert(connection->topic);
      if (type == "sensor_msgs/CameraInfo") topics_.infos.insert(connection->topic);
      if (type == "sensor_msgs/Imu") topics_.imus.insert(connection->topic);
    }
  });
}

StereoTopics InputBag::chooseTopics(const StereoTopics& named) const {
  StereoTopics topics = named;
  const auto choose = [&] {
    const bool only_compressed = topics_.images.empty() && !topics_.compressed_images.empty();
    if (only_compressed) {
      throw InputError("has compressed images only, on " + joinNames(topics_.compressed_images) +
                       ": decompress them into another bag by 'rosrun image_transport republish "
                       "compressed in:=TOPIC raw out:=TOPIC' while it is played and recorded");
    }
    if (topics.left.empty() && topics.right.empty()) {
      topics = findStereoTopics(topics_.images);
    } else if (topics.right.empty()) {
      topics.right = rightTopicOf(topics.left);
    }
    if (topics.left.empty() || topics.right.empty()) {
      throw InputError("needs both --left-topic and --right-topic here; image topics in it: " +
                       joinNames(topics_.images));
    }
    if (topics.left == topics.right) {
      throw InputError("is given the same topic twice: give --right-topic the right camera's");
    }
  };
  guarded(choose);
  return topics;
}

std::string InputBag::findImu(const StereoTopics& topics) const {
  const std::string camera = ros::names::parentNamespace(ros::names::parentNamespace(topics.left));
  std::string beside = ros::names::clean(camera + "/imu");
  if (topics_.imus.count(beside) > 0) return beside;
  return topics_.imus.size() == 1 ? *topics_.imus.begin() : "";
}

std::unique_ptr<rosbag::View> InputBag::view(const std::vector<std::string>& topics) const {
  return std::make_unique<rosbag::View>(bag_, rosbag::TopicQuery(topics));
}

void InputBag::guarded(const std::function<void()>& step) const {
  const std::string bag = "bag '" + file_ + "' ";
  try {
    step();
  } catch (const rosbag::BagUnindexedException&) {
    throw InputError(bag + "was not closed: repair it with 'rosbag reindex'");
  } catch (const rosbag::BagException& error) {
    if (std::string(error.what()).find("Unsupported bag file version") != std::string::npos) {
      throw InputError(bag + "is of a version that cannot be read (" + error.what() +
                       "; those that can are 1.2 and 2.0): convert it to 2.0");
    }
    throw InputError(bag + "cannot be read (" + error.what() +
                     "): it is cut off, damaged or no bag; try 'rosbag reindex' or fetch it again");
  } catch (const ros::Exception& error) {
    throw InputError(bag + "is damaged (" + error.what() + "): record or fetch it again");
  } catch (const MessageError& error) {
    throw InputError(bag + "cannot be used: " + error.what());
  } catch (const InputError& error) {
    throw InputError(bag + error.what());
  }
}

}  // namespace point_line_odometry
