#pragma once

/// \file
/// Conversions between ROS messages and values of the core: stamps, names, poses, covariances. Free
/// functions that need no node and no master. Messages are checked here, in image_conversion.h and
/// in calibration_conversion.h, and nowhere else.

#include <geometry_msgs/Point32.h>
#include <geometry_msgs/Pose.h>
#include <geometry_msgs/PoseWithCovariance.h>
#include <geometry_msgs/Transform.h>
#include <ros/time.h>

#include <Eigen/Geometry>
#include <cstdint>
#include <stdexcept>
#include <string>

#include "point_line_odometry/types.h"

namespace point_line_odometry {

/// A message that cannot be used; what() is one sentence that names the field, its value and a
/// hint.
class MessageError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// A frame's name as tf2 wants it.
std::string withoutLeadingSlash(const std::string& frame_id);

/// Time of a stamp [ns].
std::int64_t toNanoseconds(const ros::Time& stamp);

geometry_msgs::Point32 toPoint32(const Eigen::Vector3f& p);

/// The rotation is normalised, with w >= 0.
geometry_msgs::Pose toPose(const Eigen::Isometry3d& T);
geometry_msgs::Transform toTransform(const Eigen::Isometry3d& T);

/// Throws MessageError if a number is not finite or the norm of the quaternion is not 1 (to 1 %).
Eigen::Isometry3d toIsometry(const geometry_msgs::Pose& pose);
Eigen::Isometry3d toIsometry(const geometry_msgs::Transform& transform);

/// Row-major, translation before rotation, as in all ROS messages.
geometry_msgs::PoseWithCovariance::_covariance_type toCovariance(const Matrix6d& covariance);

}  // namespace point_line_odometry
