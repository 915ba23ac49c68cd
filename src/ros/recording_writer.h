#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "ros/frame_ring.h"
#include "ros/node_parameters.h"

namespace point_line_odometry {

/// Of whom a recording is, and where it goes.
struct RecordingTarget {
  std::string name_space;  ///< of the topics in the bag: "/stereo", "" for the root
  std::string node;        ///< its full name
  NodeParameters parameters;

  /// The folder of the node: `recorder/folder` in ROS_HOME, and in it the node's name with _ for /.
  std::filesystem::path folder() const;
};

/// What was written: bag, yaml and state.
struct RecordingFiles {
  std::filesystem::path bag;
  std::filesystem::path yaml;
  std::filesystem::path state;
};

/// Writes a recording to the target's folder: the bag with images, camera_info, odom and tf_static;
/// the state before the first frame; and last, when these are whole, the yaml with the parameters
/// and the estimate of each frame, which offline_odometry takes. Of the
/// recordings there that were written for the same reason the newest `recorder/max_files` stay.
/// \param reason a word that becomes part of the names: "lost", "asked".
/// Throws std::runtime_error that says what is wrong if it cannot be written; nothing is left then.
RecordingFiles writeRecording(const Recording& recording, const RecordingTarget& target,
                              const std::string& reason);

}  // namespace point_line_odometry
