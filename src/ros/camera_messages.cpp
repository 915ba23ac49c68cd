#include "ros/camera_messages.h"

#include <sensor_msgs/image_encodings.h>

#include <boost/make_shared.hpp>

#include "geometry/camera_axes.h"
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

Eigen::Isometry3d toBasePose(const Eigen::Isometry3d& T_first_camera) {
  const Eigen::Isometry3d T_base_camera = poseOfCameraInBase();
  return T_base_camera * T_first_camera * T_base_camera.inverse();
}

}  // namespace point_line_odometry
