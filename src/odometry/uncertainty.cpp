#include "odometry/uncertainty.h"

#include <cmath>

#include "geometry/skew.h"

namespace point_line_odometry {
namespace {

// How much a robot's velocity may change while it is not measured.
constexpr double kAcceleration = 3.0;         // [m/s^2]
constexpr double kAngularAcceleration = 3.0;  // [rad/s^2]

}  // namespace

Matrix6d composeCovariance(const Eigen::Isometry3d& T_odom_prev, const Matrix6d& pose_covariance,
                           const Eigen::Isometry3d& T_prev_curr,
                           const Matrix6d& motion_covariance) {
  const Eigen::Matrix3d& R = T_odom_prev.linear();
  const Eigen::Vector3d lever = R * T_prev_curr.translation();
  Matrix6d by_pose = Matrix6d::Identity();
  by_pose.block<3, 3>(0, 3) = -skew(lever);
  Matrix6d by_motion = Matrix6d::Zero();
  by_motion.topLeftCorner<3, 3>() = R;
  by_motion.bottomRightCorner<3, 3>() = R;
  const Matrix6d covariance = by_pose * pose_covariance * by_pose.transpose() +
                              by_motion * motion_covariance * by_motion.transpose();
  return 0.5 * (covariance + covariance.transpose());
}

Eigen::Isometry3d motionAtVelocity(const Vector6d& velocity, double dt_s) {
  Eigen::Isometry3d T_prev_curr = Eigen::Isometry3d::Identity();
  const Eigen::Vector3d rotation = velocity.tail<3>() * dt_s;
  const double angle = rotation.norm();
  if (angle > 0.0)
    T_prev_curr.linear() = Eigen::AngleAxisd(angle, rotation / angle).toRotationMatrix();
  // The camera turns while it moves: its mean axes are those of half the rotation.
  Eigen::Matrix3d half = Eigen::Matrix3d::Identity();
  if (angle > 0.0) half = Eigen::AngleAxisd(0.5 * angle, rotation / angle).toRotationMatrix();
  T_prev_curr.translation() = half * velocity.head<3>() * dt_s;
  return T_prev_curr;
}

Vector6d poseDifference(const Eigen::Isometry3d& T_odom_a, const Eigen::Isometry3d& T_odom_b) {
  const Eigen::AngleAxisd turn(T_odom_b.linear() * T_odom_a.linear().transpose());
  Vector6d difference;
  difference << T_odom_b.translation() - T_odom_a.translation(), turn.angle() * turn.axis();
  return difference;
}

Vector6d velocityOfMotion(const Eigen::Isometry3d& T_prev_curr, double dt_s) {
  const Eigen::AngleAxisd rotation(T_prev_curr.linear());
  const Eigen::Matrix3d half =
      Eigen::AngleAxisd(0.5 * rotation.angle(), rotation.axis()).toRotationMatrix();
  Vector6d velocity;
  velocity.head<3>() = half.transpose() * T_prev_curr.translation() / dt_s;
  velocity.tail<3>() = rotation.angle() * rotation.axis() / dt_s;
  return velocity;
}

Matrix6d predictionCovariance(const Vector6d& velocity, bool speed_known, double dt_s,
                              double unmeasured_s) {
  double speed_error = kAcceleration * unmeasured_s;
  double turn_error = kAngularAcceleration * unmeasured_s;
  if (!speed_known) {
    speed_error += velocity.head<3>().norm();
    turn_error += velocity.tail<3>().norm();
  }
  Matrix6d covariance = Matrix6d::Zero();
  covariance.topLeftCorner<3, 3>().diagonal().setConstant(std::pow(speed_error * dt_s, 2));
  covariance.bottomRightCorner<3, 3>().diagonal().setConstant(std::pow(turn_error * dt_s, 2));
  return covariance;
}

}  // namespace point_line_odometry
