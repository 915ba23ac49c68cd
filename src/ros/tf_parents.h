#pragma once

#include <ros/message_event.h>
#include <ros/node_handle.h>
#include <ros/subscriber.h>
#include <tf2/buffer_core.h>
#include <tf2_msgs/TFMessage.h>

#include <array>
#include <mutex>
#include <set>
#include <string>
#include <vector>

#include "ros/node_parameters.h"

namespace point_line_odometry {

/// The frame whose pose the odometry publishes on tf; empty if it publishes none.
std::string childFrameOfOdometry(const NodeParameters& parameters);

/// The frame above all others that a frame hangs below in tf: the frame itself if tf knows none.
std::string topmostFrame(const tf2::BufferCore& tf, const std::string& frame);

/// Who publishes the pose of a frame on /tf and /tf_static: a frame has one parent in tf, and one
/// publisher, else its pose changes with each message. Bounded. Thread-safe.
class TfParents {
 public:
  struct Source {
    std::string publisher;  ///< name of the node
    std::string parent;

    bool operator<(const Source& other) const {
      return publisher == other.publisher ? parent < other.parent : publisher < other.publisher;
    }
  };

  /// \param child frame, or empty: nothing is subscribed to.
  TfParents(ros::NodeHandle nh, std::string child);

  /// All so far.
  std::vector<Source> sources() const;

 private:
  void take(const ros::MessageEvent<const tf2_msgs::TFMessage>& event);

  const std::string child_;
  mutable std::mutex mutex_;
  std::set<Source> sources_;
  std::array<ros::Subscriber, 2> subscribers_;  // the last member: callbacks use the others
};

}  // namespace point_line_odometry
