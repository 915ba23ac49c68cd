#pragma once

#include <array>
#include <optional>
#include <string>
#include <vector>

#include "point_line_odometry/rectification.h"

namespace point_line_odometry {

/// What the driver of a camera publishes, for the synthetic camera to publish the same.
/// doc/cameras.md has the sources.
struct PlayedCamera {
  struct Side {
    std::string image;       ///< topic
    std::string info;        ///< topic; empty: none
    std::string frame;       ///< of the images
    std::string info_frame;  ///< of the camera_info
  };
  std::string base_frame;
  std::array<Side, 2> sides;  ///< left, right
  bool side_by_side = false;  ///< both images in one, on the left one's topic
  std::string encoding;       ///< mono8, rgb8 or bgra8
  double frame_rate_hz = 0.0;
  double right_stamp_offset_s = 0.0;  ///< of the right messages
  bool raw = false;                   ///< images are to be rectified
  StereoCalibration calibration;
};

/// Names of the cameras that can be played.
std::vector<std::string> playedCameraNames();

/// Nothing for another name.
std::optional<PlayedCamera> playedCamera(const std::string& name);

}  // namespace point_line_odometry
