#pragma once

#include <geometry_msgs/PoseStamped.h>
#include <image_transport/publisher.h>
#include <ros/node_handle.h>
#include <ros/publisher.h>

#include <Eigen/Geometry>
#include <deque>
#include <optional>

#include "ros/frame_messages.h"
#include "ros/node_parameters.h"

namespace point_line_odometry {

/// The outputs of the node: odom, tf, path, lines, points, features_image, features, info. A
/// topic without subscribers is not computed; nodelets of the same manager get it without a copy.
/// Not thread-safe.
class Publishers {
 public:
  /// \param nh names are resolved here.
  Publishers(ros::NodeHandle nh, const NodeParameters& parameters);

  /// Publishes a processed frame; of one that was not accepted only its info.
  void publish(const ProcessedFrame& frame, const FrameCounters& counters, double latency_ms);

  /// Discards path and accumulated segments; to be called after a reset of the odometry.
  void clear();

 private:
  void publishPose(const ProcessedFrame& frame);
  void publishTransform(const ProcessedFrame& frame);
  void publishPath(const ProcessedFrame& frame);
  void publishLines(const ProcessedFrame& frame);
  void publishFeatures(const ProcessedFrame& frame);
  void accumulateSegments(const ProcessedFrame& frame);

  const FrameNames names_;
  const NodeParameters parameters_;
  ros::Publisher odometry_;
  ros::Publisher path_;
  ros::Publisher lines_;
  ros::Publisher points_;
  ros::Publisher features_;
  ros::Publisher info_;
  image_transport::Publisher features_image_;
  ros::Publisher tf_;

  std::optional<Eigen::Isometry3d> T_odom_guess_;  // the last one, with guess_frame_id
  std::deque<geometry_msgs::PoseStamped> poses_;
  std::deque<AccumulatedSegment> accumulated_segments_;
  std::optional<Eigen::Isometry3d> T_odom_camera_of_last_accumulated_;
  bool markers_outdated_ = false;
};

}  // namespace point_line_odometry
