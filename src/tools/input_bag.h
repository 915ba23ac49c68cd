#pragma once

#include <rosbag/bag.h>
#include <rosbag/view.h>

#include <functional>
#include <memory>
#include <set>
#include <string>
#include <vector>

#include "common/input_error.h"
#include "tools/stereo_topics.h"

namespace point_line_odometry {

/// A bag that is read: its topics by their types, and errors that name it.
class InputBag {
 public:
  /// Throws InputError if the file cannot be read.
  explicit InputBag(std::string file);

  /// Topics by type; those of compressed images are not among `images`.
  struct Topics {
    std::set<std::string> images;
    std::set<std::string> compressed_images;
    std::set<std::string> infos;
    std::set<std::string> imus;
  };
  const Topics& topics() const { return topics_; }

  /// The topics of a stereo pair: those that are named, or found (see findStereoTopics()) where
  /// none is. Throws InputError if only one is and does not tell the other.
  StereoTopics chooseTopics(const StereoTopics& named) const;

  /// The IMU of a camera: in its namespace, or the only one in the bag; empty if there is none.
  std::string findImu(const StereoTopics& topics) const;

  /// All messages of topics, in order of time; valid as long as the bag.
  std::unique_ptr<rosbag::View> view(const std::vector<std::string>& topics) const;

  /// Runs a step that reads the bag, and throws InputError that names it for whatever is wrong.
  void guarded(const std::function<void()>& step) const;

 private:
  const std::string file_;
  rosbag::Bag bag_;
  Topics topics_;
};

/// The message itself. Throws InputError if it is of another version of its type.
template <typename Message>
typename Message::ConstPtr instantiate(const rosbag::MessageInstance& message) {
  typename Message::ConstPtr instance = message.instantiate<Message>();
  if (!instance) {
    throw InputError("has messages of another version of " + message.getDataType() + " on '" +
                     message.getTopic() + "': migrate it with 'rosbag fix'");
  }
  return instance;
}

}  // namespace point_line_odometry
