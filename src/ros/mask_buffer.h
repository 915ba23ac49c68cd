#pragma once

#include <ros/node_handle.h>
#include <ros/subscriber.h>
#include <sensor_msgs/Image.h>

#include <array>
#include <cstddef>
#include <deque>
#include <mutex>
#include <vector>

#include "ros/frame_processor.h"
#include "ros/node_parameters.h"

namespace point_line_odometry {

/// The latest masks of both cameras that came on topics; those of a pair are found by the stamps of
/// its images, which must be equal. Thread-safe.
class MaskBuffer {
 public:
  /// Masks kept for a camera, those of a pair that waits among them; the oldest is dropped first.
  static std::size_t capacity(const NodeParameters& parameters);

  explicit MaskBuffer(const NodeParameters& parameters);

  /// \param camera 0: left, 1: right.
  void add(std::size_t camera, const sensor_msgs::ImageConstPtr& mask);

  /// Whether all masks that a pair may have are here, or have been waited for long enough.
  /// \param waited_s time since the pair came.
  bool isReady(const StereoMessages& messages, double waited_s) const;

  /// The messages with those of their masks that are here. These and older masks are forgotten.
  StereoMessages withMasks(StereoMessages messages);

 private:
  sensor_msgs::ImageConstPtr find(std::size_t camera, const sensor_msgs::Image& image) const;
  void removeUntil(std::size_t camera, const ros::Time& stamp);

  const std::array<bool, 2> expected_;
  const double wait_s_;
  const std::size_t capacity_;
  mutable std::mutex mutex_;
  std::array<std::deque<sensor_msgs::ImageConstPtr>, 2> masks_;  // in the order of arrival
};

/// Subscribes to the topics of the masks that the parameters want. The buffer must outlive the
/// subscribers.
std::vector<ros::Subscriber> subscribeToMasks(ros::NodeHandle nh, const NodeParameters& parameters,
                                              MaskBuffer* buffer);

}  // namespace point_line_odometry
