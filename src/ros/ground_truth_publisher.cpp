#include "ros/ground_truth_publisher.h"

#include <nav_msgs/Odometry.h>
#include <nav_msgs/Path.h>
#include <tf2_eigen/tf2_eigen.h>

#include "geometry/se3.h"
#include "ros/conversions.h"

namespace point_line_odometry {
namespace {

constexpr std::uint32_t kQueueSize = 10;
constexpr double kPathPeriod_s = 0.5;

/// Velocity of the base in its own axes: central difference of the poses before and after.
geometry_msgs::Twist toTwist(const std::array<StampedPose, 3>& poses) {
  const Eigen::Isometry3d T_odom_before = toBasePose(poses[0].T_world_camera);
  const Eigen::Isometry3d T_odom_base = toBasePose(poses[1].T_world_camera);
  const Eigen::Isometry3d T_odom_after = toBasePose(poses[2].T_world_camera);
  const double dt_s = static_cast<double>(poses[2].stamp_ns - poses[0].stamp_ns) * 1e-9;
  const Vector6d step_odom = poseDifference(T_odom_before, T_odom_after);
  const Vector6d twist = blockRotation(T_odom_base.linear().transpose()) * step_odom / dt_s;
  return tf2::toMsg(twist);
}

}  // namespace

GroundTruthPublisher::GroundTruthPublisher(ros::NodeHandle nh, const CameraFrameNames& names,
                                           std::size_t path_max_length)
    : names_(names),
      path_max_length_(path_max_length),
      odometry_(nh.advertise<nav_msgs::Odometry>("/ground_truth/odom", kQueueSize)),
      path_(nh.advertise<nav_msgs::Path>("/ground_truth/path", 1, true)) {}

void GroundTruthPublisher::publish(const ros::Time& stamp,
                                   const std::array<StampedPose, 3>& poses) {
  geometry_msgs::PoseStamped pose;
  pose.header = makeHeader(names_.odom, stamp);
  pose.pose = toPose(toBasePose(poses[1].T_world_camera));
  poses_.push_back(pose);
  if (poses_.size() > path_max_length_) poses_.pop_front();

  if (odometry_.getNumSubscribers() > 0) {
    nav_msgs::Odometry odometry;
    odometry.header = pose.header;
    odometry.child_frame_id = names_.base;
    odometry.pose.pose = pose.pose;
    odometry.twist.twist = toTwist(poses);
    odometry_.publish(odometry);
  }
  const bool due = (ros::SteadyTime::now() - time_of_last_path_).toSec() >= kPathPeriod_s;
  if (due && path_.getNumSubscribers() > 0) publishPath();
}

void GroundTruthPublisher::publishPath() {
  if (poses_.empty()) return;
  nav_msgs::Path path;
  path.header = poses_.back().header;
  path.poses.assign(poses_.begin(), poses_.end());
  path_.publish(path);
  time_of_last_path_ = ros::SteadyTime::now();
}

}  // namespace point_line_odometry
