#pragma once

#include <memory>
#include <string>

#include "tools/stereo_source.h"

namespace point_line_odometry {

/// Which live camera is read, and for how long.
struct LiveOptions {
  std::string name_space = "stereo";     ///< of the camera
  std::string node = "stereo_odometry";  ///< odometry node within it, whose parameters are used
  std::string rectify;                   ///< "true" or "false": in place of the node's
  std::string transport;                 ///< of images; empty: the node's
  double max_interval_s = 0.0;           ///< of the stamps of a pair, if it is not 0
  double seconds = 30.0;                 ///< from the first pair on
};

/// Takes ROS' remappings out of the arguments of a program; before openLive().
void initLive(const char* node_name, int* argc, char** argv);

/// The newest stereo pair of a live camera whenever one is asked for, without masks. Throws
/// InputError if there is no master, or no pair within ten seconds.
std::unique_ptr<StereoSource> openLive(const LiveOptions& options);

}  // namespace point_line_odometry
