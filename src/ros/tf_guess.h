#pragma once

#include <ros/time.h>
#include <tf2_ros/buffer.h>

#include <Eigen/Geometry>
#include <optional>
#include <string>
#include <utility>

#include "ros/bounded_wait.h"

namespace point_line_odometry {

/// The motion of the base in another frame by tf, as a source of poses: for `guess_frame_id`.
class TfGuess {
 public:
  TfGuess(const tf2_ros::Buffer& buffer, std::string guess_frame, std::string base_frame)
      : buffer_(buffer), guess_(std::move(guess_frame)), base_(std::move(base_frame)) {}

  /// Pose of the base at a stamp, for which it waits a bounded time; nothing if tf does not have
  /// it.
  std::optional<Eigen::Isometry3d> lookUp(const ros::Time& stamp);

 private:
  const tf2_ros::Buffer& buffer_;
  const std::string guess_;
  const std::string base_;
  BoundedWait wait_;
};

}  // namespace point_line_odometry
