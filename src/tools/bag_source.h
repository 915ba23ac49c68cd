#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "tools/stereo_source.h"
#include "tools/stereo_topics.h"

namespace point_line_odometry {

/// Which stereo pairs of a bag are read.
struct BagOptions {
  std::string file;
  StereoTopics topics;                      ///< found in the bag where empty
  std::int64_t max_interval_ns = 0;         ///< 0: stamps must be equal
  bool masks = false;                       ///< read the masks on maskTopic(), by their stamps
  std::string wheel_topic = "/wheel_odom";  ///< nav_msgs/Odometry of the wheels
  std::string imu_topic = {};               ///< found in the bag if empty: see InputBag::findImu()
};

/// Stereo pairs of a bag, read without a ROS master, by the synchronisation of the node
/// (StereoInput): stamps of a pair are equal, or differ by at most the given interval. What the
/// node would reject is left out, see StereoSource::warnings(). A calibration that changes within
/// the bag is an error. The images share the memory of messages that live until the next call of
/// next(). Throws InputError if the bag cannot be read or lacks what is needed.
std::unique_ptr<StereoSource> openBag(const BagOptions& options);

}  // namespace point_line_odometry
