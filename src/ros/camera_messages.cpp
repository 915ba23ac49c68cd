#include "ros/camera_messages.h"

#include <sensor_msgs/image_encodings.h>

#include <boost/make_shared.hpp>
#include <opencv2/imgproc.hpp>

#include "geometry/camera_axes.h"
#include "odometry/uncertainty.h"
#include "ros/conversions.h"

namespace point_line_odometry {
namespace {

constexpr std::int64_t kSecond_ns = 1000000000;

/// Axes of the camera (x right, y down, z forward) in the base (x forward, y left, z up).
Eigen::Isometry3d poseOfCameraInBase() {
  Eigen::Isometry3d T_base_camera = Eigen::Isometry3d::Identity();
  T_base_camera.linear() = cameraAxesInBody();
  return T_base_camera;
}

geometry_msgs::TransformStamped makeTransform(const std_msgs::Header& parent,
                                              const std::string& child,
                                              const Eigen::Isometry3d& T_parent_child) {
  geometry_msgs::TransformStamped transform;
  transform.header = parent;
  transform.child_frame_id = child;
  transform.transform = toTransform(T_parent_child);
  return transform;
}

}  // namespace

StampShift::StampShift(std::int64_t first_stamp_ns)
    : shift_ns_(first_stamp_ns < kSecond_ns ? kSecond_ns : 0) {}

ros::Time StampShift::toRos(std::int64_t stamp_ns) const {
  ros::Time time;
  time.fromNSec(static_cast<std::uint64_t>(stamp_ns + shift_ns_));
  return time;
}

std_msgs::Header makeHeader(const std::string& frame, const ros::Time& stamp) {
  std_msgs::Header header;
  header.stamp = stamp;
  header.frame_id = frame;
  return header;
}

sensor_msgs::ImagePtr toImageMessage(const cv::Mat& image, const std_msgs::Header& header,
                                     const std::string& encoding) {
  if (encoding == sensor_msgs::image_encodings::MONO8) return toImageMessage(image, header);
  const bool alpha = encoding == sensor_msgs::image_encodings::BGRA8;
  cv::Mat colour;
  cv::cvtColor(image, colour, alpha ? cv::COLOR_GRAY2BGRA : cv::COLOR_GRAY2RGB);
  auto message = boost::make_shared<sensor_msgs::Image>();
  message->header = header;
  message->width = static_cast<std::uint32_t>(image.cols);
  message->height = static_cast<std::uint32_t>(image.rows);
  message->encoding = encoding;
  message->step = static_cast<std::uint32_t>(colour.step);
  message->data.assign(colour.data, colour.data + colour.total() * colour.elemSize());
  return message;
}

sensor_msgs::ImagePtr toImageMessage(const cv::Mat& image, const std_msgs::Header& header) {
  auto message = boost::make_shared<sensor_msgs::Image>();
  message->header = header;
  message->width = static_cast<std::uint32_t>(image.cols);
  message->height = static_cast<std::uint32_t>(image.rows);
  message->encoding = sensor_msgs::image_encodings::MONO8;
  message->step = message->width;
  const cv::Mat continuous = image.isContinuous() ? image : image.clone();
  message->data.assign(continuous.data, continuous.data + continuous.total());
  return message;
}

const char* imageTopicName(bool needs_rectification) {
  return needs_rectification ? "image_raw" : "image_rect";
}

std::vector<geometry_msgs::TransformStamped> toMountingTransforms(
    const StereoCalibration& calibration, const CameraFrameNames& names, const ros::Time& stamp) {
  return {
      makeTransform(makeHeader(names.base, stamp), names.left, poseOfCameraInBase()),
      makeTransform(makeHeader(names.left, stamp), names.right, poseOfRightInLeft(calibration))};
}

geometry_msgs::TransformStamped toImuTransform(const Eigen::Isometry3d& T_imu_camera,
                                               const CameraFrameNames& names,
                                               const ros::Time& stamp) {
  return makeTransform(makeHeader(names.left, stamp), names.imu, T_imu_camera.inverse());
}

sensor_msgs::Imu toImuMessage(const ImuSample& sample, const std_msgs::Header& header) {
  sensor_msgs::Imu message;
  message.header = header;
  message.orientation.w = 1.0;
  message.orientation_covariance[0] = -1.0;  // not measured, as sensor_msgs/Imu says
  message.angular_velocity.x = sample.angular_velocity.x();
  message.angular_velocity.y = sample.angular_velocity.y();
  message.angular_velocity.z = sample.angular_velocity.z();
  message.linear_acceleration.x = sample.acceleration.x();
  message.linear_acceleration.y = sample.acceleration.y();
  message.linear_acceleration.z = sample.acceleration.z();
  return message;
}

geometry_msgs::TransformStamped toWheelTransform(const Eigen::Isometry3d& T_body_camera,
                                                 const CameraFrameNames& names,
                                                 const ros::Time& stamp) {
  return makeTransform(makeHeader(names.base, stamp), names.wheels,
                       poseOfCameraInBase() * T_body_camera.inverse());
}

nav_msgs::Odometry toWheelMessage(const OdometrySample& sample, const OdometrySample* before,
                                  const CameraFrameNames& names, const ros::Time& stamp) {
  nav_msgs::Odometry message;
  message.header = makeHeader(names.wheel_odom, stamp);
  message.child_frame_id = names.wheels;
  message.pose.pose = toPose(sample.T_odom_body);
  message.twist.covariance = toCovariance(sample.twist_variance.asDiagonal());
  if (before == nullptr) return message;
  const double dt_s = 1e-9 * static_cast<double>(sample.stamp_ns - before->stamp_ns);
  const Vector6d twist = velocityOfMotion(before->T_odom_body.inverse() * sample.T_odom_body, dt_s);
  message.twist.twist.linear.x = twist[0];
  message.twist.twist.linear.y = twist[1];
  message.twist.twist.angular.z = twist[5];
  return message;
}

Eigen::Isometry3d toBasePose(const Eigen::Isometry3d& T_first_camera) {
  const Eigen::Isometry3d T_base_camera = poseOfCameraInBase();
  return T_base_camera * T_first_camera * T_base_camera.inverse();
}

}  // namespace point_line_odometry
