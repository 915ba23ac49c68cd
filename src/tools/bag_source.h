#pragma once

#include <console_bridge/console.h>
#include <rosbag/bag.h>
#include <rosbag/view.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Image.h>

#include <cstdlib>
#include <deque>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "ros/conversions.h"
#include "tools/stereo_source.h"

namespace point_line_odometry {

/// Image topics of a pair; camera_info is looked for beside each of them.
struct StereoTopics {
  std::string left;
  std::string right;

  bool raw() const { return left.find("rect", left.rfind('/')) == std::string::npos; }
};

/// camera_info beside an image topic.
inline std::string cameraInfoTopic(const std::string& image_topic) {
  return image_topic.substr(0, image_topic.rfind('/') + 1) + "camera_info";
}

/// The topic of the right camera by the name of the left one, empty if it cannot be told.
inline std::string rightTopicOf(const std::string& left_topic) {
  for (const auto& [left, right] : {std::pair<const char*, const char*>{"/left/", "/right/"},
                                    {"/cam0/", "/cam1/"},
                                    {"/infra1/", "/infra2/"}}) {
    const std::size_t at = left_topic.rfind(left);
    if (at == std::string::npos) continue;
    return std::string(left_topic).replace(at, std::string(left).size(), right);
  }
  return {};
}

inline std::string joinNames(const std::set<std::string>& names) {
  std::string joined;
  for (const std::string& name : names) joined += (joined.empty() ? "" : ", ") + name;
  return joined.empty() ? "none" : joined;
}

/// The pair under /stereo, or else the only pair NS/left/image_(rect|raw); rectified images go
/// before raw ones. Throws InputError that lists the candidates if there is none, or more than one.
inline StereoTopics findStereoTopics(const std::set<std::string>& image_topics) {
  std::map<std::string, StereoTopics> pairs;  // by name space
  for (const char* name : {"/left/image_rect", "/left/image_raw"}) {
    const std::string ending(name);
    for (const std::string& topic : image_topics) {
      if (topic.size() < ending.size()) continue;
      const std::string ns = topic.substr(0, topic.size() - ending.size());
      const std::string right = rightTopicOf(topic);
      if (ns + ending == topic && image_topics.count(right) > 0) pairs.insert({ns, {topic, right}});
    }
  }
  const auto stereo = pairs.find("/stereo");
  if (stereo != pairs.end()) return stereo->second;
  if (pairs.size() == 1) return pairs.begin()->second;
  if (pairs.empty()) {
    throw InputError(
        "has no topics NS/left/image_rect and NS/right/image_rect (or image_raw) of type "
        "sensor_msgs/Image: name them by --left-topic and --right-topic; image topics in it: " +
        joinNames(image_topics));
  }
  std::set<std::string> lefts;
  for (const auto& pair : pairs) lefts.insert(pair.second.left);
  throw InputError("has several stereo pairs: choose one by --left-topic; there are " +
                   joinNames(lefts));
}

/// Stereo pairs of a bag, read without a ROS master. Left and right belong together if their stamps
/// are equal, or differ by at most the given interval. A calibration that changes within the bag is
/// an error.
class BagSource : public StereoSource {
 public:
  struct Options {
    std::string file;
    StereoTopics topics;               ///< found in the bag where empty
    std::int64_t max_interval_ns = 0;  ///< 0: stamps must be equal
  };

  /// Throws InputError if the bag cannot be read or has not what is needed.
  explicit BagSource(const Options& options) : options_(options) {
    guarded([this] {
      open();
      chooseTopics();
      readCalibration();
    });
  }

  std::size_t size() const override { return size_; }
  const StereoCalibration& calibration() const override { return calibration_; }
  bool needsRectification() const override { return options_.topics.raw(); }
  std::size_t unpaired() const override { return unpaired_; }

  /// The images share the memory of messages that live until the next call.
  std::optional<StereoImages> next() override {
    std::optional<StereoImages> images;
    guarded([&] {
      while (!images && message_ != view_->end()) {
        take(*message_);
        ++message_;
        if (findPair()) images = toStereoImages(*left_, *right_, calibration_);
      }
      if (!images) finish();
    });
    return images;
  }

 private:
  using ImageQueue = std::deque<sensor_msgs::Image::ConstPtr>;

  /// Images of one camera that wait for a partner are bounded, should the other one be missing.
  static constexpr std::size_t kMaxWaiting = 100;

  /// Runs a step and puts the name of the bag before the text of its errors.
  template <typename Step>
  void guarded(const Step& step) {
    const std::string bag = "bag '" + options_.file + "' ";
    try {
      step();
    } catch (const rosbag::BagUnindexedException&) {
      throw InputError(bag + "was not closed: repair it with 'rosbag reindex'");
    } catch (const rosbag::BagException& error) {
      throw InputError(
          bag + "cannot be read (" + error.what() +
          "): it is cut off, damaged or no bag; try 'rosbag reindex' or fetch it again");
    } catch (const ros::Exception& error) {
      throw InputError(bag + "is damaged (" + error.what() + "): record or fetch it again");
    } catch (const MessageError& error) {
      throw InputError(bag + "cannot be used: " + error.what());
    } catch (const InputError& error) {
      throw InputError(bag + error.what());
    }
  }

  void open() {
    // The bag library logs faults before it throws them; they are told once, by the exception.
    console_bridge::noOutputHandler();
    bag_.open(options_.file, rosbag::bagmode::Read);
    rosbag::View all(bag_);
    for (const rosbag::ConnectionInfo* connection : all.getConnections()) {
      if (connection->datatype == "sensor_msgs/Image") images_.insert(connection->topic);
      if (connection->datatype == "sensor_msgs/CameraInfo") infos_.insert(connection->topic);
    }
  }

  void chooseTopics() {
    StereoTopics& topics = options_.topics;
    if (topics.left.empty() && topics.right.empty()) {
      topics = findStereoTopics(images_);
    } else if (topics.right.empty()) {
      topics.right = rightTopicOf(topics.left);
    }
    if (topics.left.empty() || topics.right.empty()) {
      throw InputError("needs both --left-topic and --right-topic here; image topics in it: " +
                       joinNames(images_));
    }
    for (const std::string& topic : {topics.left, topics.right}) {
      if (images_.count(topic) == 0) {
        throw InputError(
            "has no topic '" + topic + "' of type sensor_msgs/Image: name both " +
            "cameras by --left-topic and --right-topic; image topics in it: " + joinNames(images_));
      }
    }
    if (topics.left == topics.right) {
      throw InputError("is asked for the same topic twice: give --right-topic the right camera's");
    }
  }

  void readCalibration() {
    const StereoTopics& topics = options_.topics;
    left_info_ = firstInfo(cameraInfoTopic(topics.left));
    right_info_ = firstInfo(cameraInfoTopic(topics.right));
    calibration_ = toStereoCalibration(*left_info_, *right_info_);
    size_ = std::min(rosbag::View(bag_, rosbag::TopicQuery(topics.left)).size(),
                     rosbag::View(bag_, rosbag::TopicQuery(topics.right)).size());
    view_ = std::make_unique<rosbag::View>(
        bag_, rosbag::TopicQuery(std::vector<std::string>{topics.left, topics.right,
                                                          cameraInfoTopic(topics.left),
                                                          cameraInfoTopic(topics.right)}));
    message_ = view_->begin();
  }

  sensor_msgs::CameraInfo::ConstPtr firstInfo(const std::string& topic) {
    rosbag::View view(bag_, rosbag::TopicQuery(topic));
    if (infos_.count(topic) == 0 || view.size() == 0) {
      throw InputError("has no topic '" + topic +
                       "' of type sensor_msgs/CameraInfo: record it together with the images");
    }
    return instantiate<sensor_msgs::CameraInfo>(*view.begin());
  }

  template <typename Message>
  static typename Message::ConstPtr instantiate(const rosbag::MessageInstance& message) {
    typename Message::ConstPtr instance = message.instantiate<Message>();
    if (!instance) {
      throw InputError("has messages of another version of " + message.getDataType() + " on '" +
                       message.getTopic() + "': migrate it with 'rosbag fix'");
    }
    return instance;
  }

  void take(const rosbag::MessageInstance& message) {
    const std::string& topic = message.getTopic();
    if (topic == options_.topics.left) {
      enqueue(message, &waiting_left_);
    } else if (topic == options_.topics.right) {
      enqueue(message, &waiting_right_);
    } else {
      const bool left = topic == cameraInfoTopic(options_.topics.left);
      const auto info = instantiate<sensor_msgs::CameraInfo>(message);
      if (sameCalibration(*info, left ? *left_info_ : *right_info_)) return;
      throw InputError("changes its calibration on '" + topic + "' at " +
                       std::to_string(info->header.stamp.toSec()) +
                       " s: cut it there with 'rosbag filter' and run the parts apart");
    }
  }

  void enqueue(const rosbag::MessageInstance& message, ImageQueue* queue) {
    queue->push_back(instantiate<sensor_msgs::Image>(message));
    if (queue->size() > kMaxWaiting) drop(queue);
  }

  void drop(ImageQueue* queue) {
    queue->pop_front();
    ++unpaired_;
  }

  /// Moves the oldest pair from the queues to left_ and right_; older images without partner are
  /// dropped.
  bool findPair() {
    while (!waiting_left_.empty() && !waiting_right_.empty()) {
      const std::int64_t ahead_ns = toNanoseconds(waiting_left_.front()->header.stamp) -
                                    toNanoseconds(waiting_right_.front()->header.stamp);
      if (std::abs(ahead_ns) <= options_.max_interval_ns) {
        left_ = waiting_left_.front();
        right_ = waiting_right_.front();
        waiting_left_.pop_front();
        waiting_right_.pop_front();
        ++pairs_;
        return true;
      }
      drop(ahead_ns < 0 ? &waiting_left_ : &waiting_right_);
    }
    return false;
  }

  void finish() {
    unpaired_ += waiting_left_.size() + waiting_right_.size();
    waiting_left_.clear();
    waiting_right_.clear();
    if (pairs_ > 0) return;
    throw InputError(
        "has no left and right image of equal stamp: synchronise the cameras, or "
        "allow a difference by --approximate-sync SECONDS");
  }

  Options options_;
  rosbag::Bag bag_;
  std::set<std::string> images_;
  std::set<std::string> infos_;
  sensor_msgs::CameraInfo::ConstPtr left_info_;
  sensor_msgs::CameraInfo::ConstPtr right_info_;
  StereoCalibration calibration_;
  std::size_t size_ = 0;
  std::unique_ptr<rosbag::View> view_;
  rosbag::View::iterator message_;
  ImageQueue waiting_left_;
  ImageQueue waiting_right_;
  sensor_msgs::Image::ConstPtr left_;
  sensor_msgs::Image::ConstPtr right_;
  std::size_t pairs_ = 0;
  std::size_t unpaired_ = 0;
};

}  // namespace point_line_odometry
