#include "ros/conversions.h"

#include <tf2_eigen/tf2_eigen.h>

#include <cmath>
#include <string>

namespace point_line_odometry {
namespace {

/// Checks what tf2_eigen does not: numbers that are not finite, quaternions that are not unit.
template <typename Translation>
Eigen::Isometry3d makeIsometry(const Translation& translation,
                               const geometry_msgs::Quaternion& rotation) {
  constexpr double kNormTolerance = 0.01;
  Eigen::Vector3d t;
  Eigen::Quaterniond q;
  tf2::fromMsg(translation, t);
  tf2::fromMsg(rotation, q);
  if (!t.allFinite() || !q.coeffs().allFinite()) {
    throw MessageError("pose: a number is not finite; send finite numbers");
  }
  if (std::abs(q.norm() - 1.0) > kNormTolerance) {
    throw MessageError("pose: length of the orientation quaternion is " + std::to_string(q.norm()) +
                       ": it must be 1; for no rotation send w: 1");
  }
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() = q.normalized().toRotationMatrix();
  T.translation() = t;
  return T;
}

/// Normalised and with w >= 0, which tf2_eigen does not do: a rotation of a calibration file may
/// have a few digits only.
geometry_msgs::Quaternion toQuaternion(const Eigen::Matrix3d& R) {
  Eigen::Quaterniond q = Eigen::Quaterniond(R).normalized();
  if (q.w() < 0.0) q.coeffs() = -q.coeffs();
  return tf2::toMsg(q);
}

}  // namespace

std::string withoutLeadingSlash(const std::string& frame_id) {
  return frame_id.substr(frame_id.find_first_not_of('/') == 1 ? 1 : 0);
}

std::int64_t toNanoseconds(const ros::Time& stamp) {
  return static_cast<std::int64_t>(stamp.toNSec());
}

geometry_msgs::Point32 toPoint32(const Eigen::Vector3f& p) {
  geometry_msgs::Point32 point;
  point.x = p.x();
  point.y = p.y();
  point.z = p.z();
  return point;
}

geometry_msgs::Pose toPose(const Eigen::Isometry3d& T) {
  geometry_msgs::Pose pose;
  pose.position = tf2::toMsg(Eigen::Vector3d(T.translation()));
  pose.orientation = toQuaternion(T.linear());
  return pose;
}

geometry_msgs::Transform toTransform(const Eigen::Isometry3d& T) {
  geometry_msgs::Transform transform;
  tf2::toMsg(Eigen::Vector3d(T.translation()), transform.translation);
  transform.rotation = toQuaternion(T.linear());
  return transform;
}

Eigen::Isometry3d toIsometry(const geometry_msgs::Pose& pose) {
  return makeIsometry(pose.position, pose.orientation);
}

Eigen::Isometry3d toIsometry(const geometry_msgs::Transform& transform) {
  return makeIsometry(transform.translation, transform.rotation);
}

geometry_msgs::PoseWithCovariance::_covariance_type toCovariance(const Matrix6d& covariance) {
  geometry_msgs::PoseWithCovariance::_covariance_type values;
  Eigen::Map<Eigen::Matrix<double, 6, 6, Eigen::RowMajor>>(values.data()) = covariance;
  return values;
}

}  // namespace point_line_odometry
