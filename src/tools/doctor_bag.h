#pragma once

#include <rosbag/bag.h>
#include <tf2/buffer_core.h>

#include <functional>
#include <set>
#include <string>
#include <vector>

#include "ros/doctor_imu.h"
#include "ros/stereo_input.h"
#include "tools/stereo_topics.h"

namespace point_line_odometry {

/// A bag to be checked: faults of its topics are left to the report, only a file that cannot be
/// read is an error.
class DoctorBag {
 public:
  using TakeSet = std::function<void(const StereoMessages& set, double time_s)>;

  /// Throws InputError if the file cannot be read.
  explicit DoctorBag(const std::string& file);

  /// The pair that the nodelet would subscribe to in a namespace, or else the only one in the bag.
  /// \param rectify raw images are asked for.
  StereoTopics findTopics(const std::string& name_space, bool rectify) const;

  std::vector<std::string> imageTopics() const;

  /// The IMU of the camera: in its namespace, or the only one in the bag; empty if there is none.
  std::string findImu(const StereoTopics& topics) const;

  /// Reads the samples of a topic in the time that read() has read. Throws InputError likewise.
  ImuCheckFacts readImu(const std::string& topic) const;

  /// Reads `seconds` of the bag from the first message of these topics on, and all static
  /// transforms. \param take called with each complete set. Throws InputError if the bag is
  /// damaged.
  InputFacts read(const StereoTopics& topics, const NodeParameters& parameters, double seconds,
                  const TakeSet& take);

  /// The transforms that read() has found.
  const tf2::BufferCore& transforms() const { return tf_; }

 private:
  void guarded(const std::function<void()>& step) const;

  void readTransforms(const ros::Time& end);

  const std::string file_;
  rosbag::Bag bag_;
  std::set<std::string> images_;
  std::set<std::string> compressed_;
  std::set<std::string> imus_;
  ros::Time begin_ = ros::TIME_MIN;  // of what was read
  ros::Time end_ = ros::TIME_MAX;
  tf2::BufferCore tf_;
};

}  // namespace point_line_odometry
