#pragma once

#include <Eigen/Geometry>
#include <functional>
#include <optional>
#include <string>
#include <utility>

#include "ros/confirmation.h"

namespace point_line_odometry {

/// Where the camera sits on the robot: looked up once for the frame that the images' headers name,
/// never assumed. Another frame_id counts when kConfirmations frames in a row have it. Not
/// thread-safe.
class CameraMounting {
 public:
  /// Pose in the base of a camera's frame; throws an exception if it is not known.
  using Lookup = std::function<Eigen::Isometry3d(const std::string& camera)>;

  explicit CameraMounting(Lookup lookup) : lookup_(std::move(lookup)) {}

  /// Looks the frame up if need be. Throws what the lookup throws while the transform is not known
  /// that the frame must wait for.
  void prepare(const std::string& frame_id);

  /// Pose in the base of the frame of a prepared header. Throws MessageError if it is another frame
  /// than before, which is not confirmed.
  const Eigen::Isometry3d& take(const std::string& frame_id);

 private:
  struct Known {
    std::string camera;
    Eigen::Isometry3d T_base_header;
  };

  Lookup lookup_;
  std::optional<Known> known_;
  Confirmation<std::string> other_camera_;
};

}  // namespace point_line_odometry
