#pragma once

/// \file
/// Between ROS messages and the values of the core: images, calibration, poses, covariances. Free
/// functions that need no node and no master; whatever comes from outside is checked here and
/// nowhere else.

#include <geometry_msgs/Point.h>
#include <geometry_msgs/Point32.h>
#include <geometry_msgs/Pose.h>
#include <geometry_msgs/PoseWithCovariance.h>
#include <geometry_msgs/Transform.h>
#include <geometry_msgs/TwistWithCovariance.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Image.h>
#include <std_msgs/Header.h>

#include <Eigen/Geometry>
#include <cstdint>
#include <opencv2/core.hpp>
#include <stdexcept>
#include <string>

#include "point_line_odometry/rectification.h"
#include "point_line_odometry/types.h"

namespace point_line_odometry {

/// A message that cannot be used; what() is one sentence that names the field, its value and the
/// cure.
class MessageError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// Grey picture of an image message, CV_8UC1. Takes mono8, 8UC1, mono16, 16UC1 (v / 256, rounded
/// down), bgr8, rgb8, bgra8 and rgba8. Throws MessageError for other encodings and for sizes that
/// contradict each other, before a pixel is read. For mono8 and 8UC1 the result shares the memory
/// of the message: keep the message as long as the result, and never write to it.
cv::Mat toGray(const sensor_msgs::Image& image);

/// Both pictures of a pair, as toGray(), with the stamp of the left one. Throws MessageError also
/// if a picture has not the size that its calibration says. Messages must outlive the result.
StereoImages toStereoImages(const sensor_msgs::Image& left, const sensor_msgs::Image& right,
                            const StereoCalibration& calibration);

/// Calibration of the images as they are transmitted: K and P with region of interest and binning
/// applied (fields that are 0 are unset). Throws MessageError if P cannot belong to a rectified
/// pair: absent, not finite, f <= 0, baseline <= 0, or if left and right differ in size.
StereoCalibration toStereoCalibration(const sensor_msgs::CameraInfo& left,
                                      const sensor_msgs::CameraInfo& right);

/// K, D, R, P and size of a camera; no binning, no region of interest.
sensor_msgs::CameraInfo toCameraInfo(const CameraCalibration& calibration,
                                     const std_msgs::Header& header);

/// Name of the first field in which the messages describe different cameras, null if they do not;
/// the header does not count.
const char* differingField(const sensor_msgs::CameraInfo& a, const sensor_msgs::CameraInfo& b);

/// True if there is no such field.
bool sameCalibration(const sensor_msgs::CameraInfo& a, const sensor_msgs::CameraInfo& b);

/// A frame's name as tf2 wants it.
std::string withoutLeadingSlash(const std::string& frame_id);

/// Time of a stamp [ns].
std::int64_t toNanoseconds(const ros::Time& stamp);

geometry_msgs::Point toPoint(const Eigen::Vector3d& p);
geometry_msgs::Point32 toPoint32(const Eigen::Vector3f& p);

/// The rotation is normalised, with w >= 0.
geometry_msgs::Quaternion toQuaternion(const Eigen::Quaterniond& q);
geometry_msgs::Pose toPose(const Eigen::Isometry3d& T);
geometry_msgs::Transform toTransform(const Eigen::Isometry3d& T);

/// Throws MessageError if a number is not finite or the quaternion has not length one (to 1 %).
Eigen::Isometry3d toIsometry(const geometry_msgs::Pose& pose);
Eigen::Isometry3d toIsometry(const geometry_msgs::Transform& transform);

/// Row-major, translation before rotation, as in all ROS messages.
geometry_msgs::PoseWithCovariance::_covariance_type toCovariance(const Matrix6d& covariance);

/// 6 x 6 matrix A with twist_a = A * twist_b for a rigid body that carries frames a and b; twists
/// are linear, then angular velocity of the frame's origin in the frame's own axes.
Matrix6d twistAdjoint(const Eigen::Isometry3d& T_a_b);

/// Covariance of T_odom_base = T_odom_camera * T_camera_base from that of T_odom_camera; both along
/// and about odom's axes.
Matrix6d basePoseCovariance(const Matrix6d& camera_covariance,
                            const Eigen::Isometry3d& T_odom_camera,
                            const Eigen::Isometry3d& T_camera_base);

}  // namespace point_line_odometry
