#include "ros/publishers.h"

#include <image_transport/image_transport.h>
#include <nav_msgs/Path.h>
#include <sensor_msgs/PointCloud2.h>
#include <tf2_msgs/TFMessage.h>
#include <visualization_msgs/MarkerArray.h>

#include <boost/make_shared.hpp>
#include <utility>

#include "geometry/se3.h"
#include "ros/conversions.h"

namespace point_line_odometry {
namespace {

constexpr std::uint32_t kQueueSize = 10;
constexpr std::uint32_t kTfQueueSize = 100;  // as tf2_ros::TransformBroadcaster

/// True if the camera has moved far enough for another set of segments.
bool movedOn(const Eigen::Isometry3d& T_odom_a, const Eigen::Isometry3d& T_odom_b) {
  constexpr double kStepM = 0.5;
  constexpr double kStepRad = 0.2;
  const Eigen::Isometry3d T_a_b = T_odom_a.inverse() * T_odom_b;
  return T_a_b.translation().norm() > kStepM || rotationAngle(T_a_b.linear()) > kStepRad;
}

/// Publishes a message as a shared pointer, which nodelets of the same manager get without a copy.
template <typename Message>
void publishShared(const ros::Publisher& publisher, Message message) {
  publisher.publish(boost::make_shared<const Message>(std::move(message)));
}

template <typename Deque>
void limitSize(std::size_t size, Deque* items) {
  if (items->size() <= size) return;
  items->erase(items->begin(), items->end() - static_cast<std::ptrdiff_t>(size));
}

}  // namespace

Publishers::Publishers(ros::NodeHandle nh, const NodeParameters& parameters)
    : names_{parameters.odom_frame_id, parameters.base_frame_id},
      parameters_(parameters),
      odometry_(nh.advertise<nav_msgs::Odometry>("odom", kQueueSize)),
      path_(nh.advertise<nav_msgs::Path>("path", 1)),
      lines_(nh.advertise<visualization_msgs::MarkerArray>("lines", 1)),
      points_(nh.advertise<sensor_msgs::PointCloud2>("points", 1)),
      features_(nh.advertise<StereoFeatures>("features", kQueueSize)),
      info_(nh.advertise<OdometryInfo>("info", kQueueSize)),
      features_image_(image_transport::ImageTransport(nh).advertise("features_image", 1)) {
  // By this handle, and so with the node's remappings, which a TransformBroadcaster does not know
  // in a nodelet.
  if (parameters.publish_tf) tf_ = nh.advertise<tf2_msgs::TFMessage>("/tf", kTfQueueSize);
}

void Publishers::publish(const ProcessedFrame& frame, const FrameCounters& counters,
                         double latency_ms) {
  if (info_.getNumSubscribers() > 0) publishShared(info_, toInfo(frame, counters, latency_ms));
  if (!frame.result.accepted()) return;
  publishPose(frame);
  publishPath(frame);
  publishLines(frame);
  publishFeatures(frame);
}

void Publishers::clear() {
  T_odom_guess_.reset();
  poses_.clear();
  accumulated_segments_.clear();
  T_odom_camera_of_last_accumulated_.reset();
  markers_outdated_ = true;
}

void Publishers::publishPose(const ProcessedFrame& frame) {
  if (parameters_.publish_tf) publishTransform(frame);
  if (odometry_.getNumSubscribers() > 0) publishShared(odometry_, toOdometry(frame, names_));
}

/// With guess_frame_id, which is the parent of the base, odom is the parent of that. Where tf does
/// not know the base in it, its last pose in odom is kept.
void Publishers::publishTransform(const ProcessedFrame& frame) {
  const auto publish = [this](geometry_msgs::TransformStamped transform) {
    tf2_msgs::TFMessage message;
    message.transforms.push_back(std::move(transform));
    tf_.publish(message);
  };
  if (!usesTfGuess(parameters_)) {
    publish(toTransformStamped(frame, names_, parameters_.invert_tf));
    return;
  }
  const Eigen::Isometry3d T_odom_base = frame.T_odom_base();
  if (frame.T_guess_base) T_odom_guess_ = T_odom_base * frame.T_guess_base->inverse();
  if (!T_odom_guess_) return;
  publish(toTransformStamped(frame, {names_.odom, parameters_.guess_frame_id},
                             parameters_.invert_tf, T_odom_guess_->inverse() * T_odom_base));
}

void Publishers::publishPath(const ProcessedFrame& frame) {
  geometry_msgs::PoseStamped pose;
  pose.header.stamp = frame.header.stamp;
  pose.header.frame_id = names_.odom;
  pose.pose = toPose(frame.T_odom_base());
  poses_.push_back(pose);
  limitSize(static_cast<std::size_t>(parameters_.path_max_length), &poses_);
  if (path_.getNumSubscribers() == 0) return;
  nav_msgs::Path path;
  path.header = pose.header;
  path.poses.assign(poses_.begin(), poses_.end());
  publishShared(path_, std::move(path));
}

void Publishers::publishLines(const ProcessedFrame& frame) {
  if (lines_.getNumSubscribers() == 0) return;
  accumulateSegments(frame);
  visualization_msgs::MarkerArray markers = toLineMarkers(frame);
  std_msgs::Header odom_header = frame.header;
  odom_header.frame_id = names_.odom;
  if (!accumulated_segments_.empty())
    markers.markers.push_back(toAccumulatedMarker(accumulated_segments_, odom_header));
  if (markers_outdated_)
    markers.markers.insert(markers.markers.begin(), deleteAllMarkers(odom_header));
  markers_outdated_ = false;
  publishShared(lines_, std::move(markers));
}

void Publishers::accumulateSegments(const ProcessedFrame& frame) {
  if (frame.result.state != TrackingState::kOk) return;
  const Eigen::Isometry3d& T_odom_camera = frame.result.T_odom_camera;
  if (T_odom_camera_of_last_accumulated_ &&
      !movedOn(*T_odom_camera_of_last_accumulated_, T_odom_camera)) {
    return;
  }
  const std::vector<AccumulatedSegment> seen = toAccumulatedSegments(frame);
  if (seen.empty()) return;
  accumulated_segments_.insert(accumulated_segments_.end(), seen.begin(), seen.end());
  limitSize(static_cast<std::size_t>(parameters_.landmarks_max_count), &accumulated_segments_);
  T_odom_camera_of_last_accumulated_ = T_odom_camera;
}

void Publishers::publishFeatures(const ProcessedFrame& frame) {
  if (points_.getNumSubscribers() > 0) publishShared(points_, toPointCloud(frame));
  if (features_.getNumSubscribers() > 0) publishShared(features_, toFeatures(frame));
  if (features_image_.getNumSubscribers() > 0) features_image_.publish(toFeaturesImage(frame));
}

}  // namespace point_line_odometry
