#pragma once

#include <ros/message_event.h>
#include <ros/node_handle.h>
#include <ros/subscriber.h>
#include <tf2/buffer_core.h>
#include <tf2_msgs/TFMessage.h>

#include <array>
#include <map>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "ros/node_parameters.h"

namespace point_line_odometry {

/// A transform of tf, by its frames.
struct TfEdge {
  std::string parent;
  std::string child;
};

/// What the odometry publishes on tf; nothing if publish_tf is false.
std::optional<TfEdge> transformOfOdometry(const NodeParameters& parameters);

/// The topmost frame of the robot that a frame hangs below in tf: the frame itself if tf has none.
/// Odometries, maps and the world (REP 105) are not of the robot. \param odom frame of this
/// odometry.
std::string topmostFrame(const tf2::BufferCore& tf, const std::string& frame,
                         const std::string& odom);

/// Who publishes the pose of a frame on /tf, within the last seconds, and on /tf_static: a frame
/// has one parent in tf, and one publisher, else its pose changes with each message. Bounded.
/// Thread-safe.
class TfParents {
 public:
  struct Source {
    std::string publisher;  ///< name of the node, of a nodelet that of its manager
    std::string parent;

    bool operator<(const Source& other) const {
      return publisher == other.publisher ? parent < other.parent : publisher < other.publisher;
    }
  };

  /// \param own the odometry's transform; nothing is subscribed to without.
  TfParents(ros::NodeHandle nh, std::optional<TfEdge> own);

  /// Without the odometry itself. \param node in which it runs: of another nodelet of the same
  /// manager nothing but another parent tells.
  std::vector<Source> othersThan(const std::string& node) const;

 private:
  void take(const ros::MessageEvent<const tf2_msgs::TFMessage>& event, bool latched);

  const std::optional<TfEdge> own_;
  mutable std::mutex mutex_;
  std::map<Source, double> valid_until_s_;      // wall time
  std::array<ros::Subscriber, 2> subscribers_;  // the last member: callbacks use the others
};

}  // namespace point_line_odometry
