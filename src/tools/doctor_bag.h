#pragma once

#include <ros/time.h>
#include <tf2/buffer_core.h>

#include <functional>
#include <set>
#include <string>
#include <vector>

#include "ros/doctor_imu.h"
#include "ros/mask_buffer.h"
#include "ros/stereo_input.h"
#include "tools/input_bag.h"
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
  /// \param named those that are to be used; found if empty. \param rectify raw images are asked
  /// for. Throws InputError if only one is named and does not tell the other.
  StereoTopics findTopics(const StereoTopics& named, const std::string& name_space,
                          bool rectify) const;

  std::vector<std::string> imageTopics() const;

  /// As InputBag::findImu().
  std::string findImu(const StereoTopics& topics) const { return bag_.findImu(topics); }

  /// Reads the samples of a topic in the time that read() has read. Throws InputError likewise.
  ImuCheckFacts readImu(const std::string& topic) const;

  /// Reads `seconds` of the bag from the first image of these topics on, and all static
  /// transforms. \param take called with each complete set. Throws InputError if the bag is
  /// damaged.
  InputFacts read(const StereoTopics& topics, const NodeParameters& parameters, double seconds,
                  const TakeSet& take);

  /// Reads the masks of the images with these stamps. Throws InputError likewise.
  void readMasks(const StereoTopics& topics, const std::set<ros::Time>& stamps,
                 MaskBuffer* masks) const;

  /// The choice of `mask_images` that uses all masks of these topics.
  std::string maskImages(const StereoTopics& topics) const;

  /// The transforms that read() has found.
  const tf2::BufferCore& transforms() const { return tf_; }

 private:
  void readTransforms(const ros::Time& end);

  const InputBag bag_;
  ros::Time begin_ = ros::TIME_MIN;  // of what was read
  ros::Time end_ = ros::TIME_MAX;
  tf2::BufferCore tf_;
};

}  // namespace point_line_odometry
