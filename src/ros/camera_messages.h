#pragma once

/// \file
/// From values of the core to the messages that a stereo camera publishes; shared by the bags that
/// the tools write and by the synthetic camera. Free functions that need no node.
///
/// base_link (x forward, y left, z up) lies at the centre of the left camera; base_link ->
/// left_camera is only the rotation from body to optical axes. For raw images left_camera is the
/// camera that took the images, before rectification.

#include <geometry_msgs/TransformStamped.h>
#include <nav_msgs/Odometry.h>
#include <sensor_msgs/Image.h>
#include <sensor_msgs/Imu.h>
#include <std_msgs/Header.h>

#include <Eigen/Geometry>
#include <cstdint>
#include <opencv2/core/mat.hpp>
#include <string>
#include <vector>

#include "point_line_odometry/gyroscope.h"
#include "point_line_odometry/rectification.h"
#include "point_line_odometry/wheel_odometry.h"

namespace point_line_odometry {

/// Names of the frames of a stereo camera on its robot.
struct CameraFrameNames {
  std::string odom = "odom";
  std::string base = "base_link";
  std::string left = "left_camera";
  std::string right = "right_camera";
  std::string imu = "imu";
  std::string wheels = "wheels";
  std::string wheel_odom = "wheel_odom";  ///< in which their odometry gives its pose
};

/// Shifts stamps that begin at 0, which is no valid time in ROS, by one second.
class StampShift {
 public:
  explicit StampShift(std::int64_t first_stamp_ns);

  bool shifts() const { return shift_ns_ > 0; }
  ros::Time toRos(std::int64_t stamp_ns) const;

 private:
  std::int64_t shift_ns_;
};

std_msgs::Header makeHeader(const std::string& frame, const ros::Time& stamp);

/// The image as mono8; a deep copy. \param image CV_8UC1.
sensor_msgs::ImagePtr toImageMessage(const cv::Mat& image, const std_msgs::Header& header);

/// The same in colour: mono8, rgb8 or bgra8.
sensor_msgs::ImagePtr toImageMessage(const cv::Mat& image, const std_msgs::Header& header,
                                     const std::string& encoding);

/// Topic name of a camera's images within its namespace.
const char* imageTopicName(bool needs_rectification);

/// base -> left camera -> right camera.
std::vector<geometry_msgs::TransformStamped> toMountingTransforms(
    const StereoCalibration& calibration, const CameraFrameNames& names, const ros::Time& stamp);

/// left camera -> IMU.
geometry_msgs::TransformStamped toImuTransform(const Eigen::Isometry3d& T_imu_camera,
                                               const CameraFrameNames& names,
                                               const ros::Time& stamp);

/// A sample without orientation, which an IMU does not measure.
sensor_msgs::Imu toImuMessage(const ImuSample& sample, const std_msgs::Header& header);

/// The topic of the wheels' odometry.
constexpr const char* kWheelTopic = "/wheel_odom";

/// base -> wheels.
geometry_msgs::TransformStamped toWheelTransform(const Eigen::Isometry3d& T_body_camera,
                                                 const CameraFrameNames& names,
                                                 const ros::Time& stamp);

/// Pose of the wheels, and the twist since the pose before it. \param before null: no twist.
nav_msgs::Odometry toWheelMessage(const OdometrySample& sample, const OdometrySample* before,
                                  const CameraFrameNames& names, const ros::Time& stamp);

/// Pose of the base relative to its first pose, from that of the left camera relative to its own.
Eigen::Isometry3d toBasePose(const Eigen::Isometry3d& T_first_camera);

}  // namespace point_line_odometry
