#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "ros/frame_ring.h"
#include "ros/node_parameters.h"

namespace point_line_odometry {

/// The node that a recording is of, and its folder.
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

/// Writes a recording to the target's folder: the bag with images, the masks that were used,
/// camera_info, odom and tf_static; the state before the first frame; and last, when these are
/// complete, the yaml with the parameters and the estimate of each frame, which offline_odometry
/// reads. Of the recordings with the same reason the newest `recorder/max_files` are kept.
/// \param reason a word that becomes part of the names: "lost", "asked".
/// Throws std::runtime_error with the reason if it cannot be written; no files are left then.
RecordingFiles writeRecording(const Recording& recording, const RecordingTarget& target,
                              const std::string& reason);

}  // namespace point_line_odometry
