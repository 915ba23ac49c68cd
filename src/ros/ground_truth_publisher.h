#pragma once

#include <geometry_msgs/PoseStamped.h>
#include <ros/node_handle.h>
#include <ros/publisher.h>

#include <array>
#include <deque>

#include "dataset/trajectory.h"
#include "ros/camera_messages.h"

namespace point_line_odometry {

/// Publishes the true pose of the base in odom, which is the pose of the base at the first frame:
/// /ground_truth/odom at every frame, /ground_truth/path at most twice a second, both only if they
/// have subscribers. No tf: odom -> base is published by the odometry. Not thread-safe.
class GroundTruthPublisher {
 public:
  GroundTruthPublisher(ros::NodeHandle nh, const CameraFrameNames& names,
                       std::size_t path_max_length);

  /// \param poses of the left camera relative to the first frame: before, at and after this frame;
  /// the velocity is computed from the outer ones.
  void publish(const ros::Time& stamp, const std::array<StampedPose, 3>& poses);

  /// Publishes the path now, latched.
  void publishPath();

 private:
  const CameraFrameNames names_;
  const std::size_t path_max_length_;
  ros::Publisher odometry_;
  ros::Publisher path_;
  std::deque<geometry_msgs::PoseStamped> poses_;
  ros::SteadyTime time_of_last_path_;
};

}  // namespace point_line_odometry
