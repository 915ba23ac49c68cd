#pragma once

#include <Eigen/Geometry>
#include <functional>
#include <optional>
#include <string>
#include <utility>

#include "ros/confirmation.h"

namespace point_line_odometry {

/// Pose of a camera or another sensor in the base: looked up once for the frame_id of its messages,
/// never assumed. Another frame_id is accepted when kConfirmations messages in a row have it. Not
/// thread-safe.
class SensorMounting {
 public:
  /// Pose in the base of a sensor's frame; throws an exception if it is not known.
  using Lookup = std::function<Eigen::Isometry3d(const std::string& sensor)>;

  /// \param source of the messages, for errors.
  SensorMounting(std::string source, Lookup lookup)
      : source_(std::move(source)), lookup_(std::move(lookup)) {}

  /// Looks the frame up if it is not the known one. Throws what the lookup throws while the
  /// transform is not available; an image has to wait for it.
  void prepare(const std::string& frame_id);

  /// Pose of a prepared frame in the base. Throws MessageError if it is another frame than before
  /// and not confirmed yet.
  const Eigen::Isometry3d& take(const std::string& frame_id);

 private:
  struct Known {
    std::string sensor;
    Eigen::Isometry3d T_base_header;
  };

  const std::string source_;
  Lookup lookup_;
  std::optional<Known> known_;
  Confirmation<std::string> other_sensor_;
};

}  // namespace point_line_odometry
