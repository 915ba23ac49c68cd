#include "odometry/steady_pose.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

#include "odometry/uncertainty.h"

namespace point_line_odometry {
namespace {

// How fast the pose may move beside the measured motion: what a controller can stand.
constexpr double kBesideShare = 0.2;  // of the camera's own speed
constexpr double kBesideSpeed = 0.1;  // [m/s] and [rad/s], of a camera that stands

constexpr double kFadeTime_s = 0.5;     // in which an offset fades to a third of itself, if it may
constexpr double kLongestStep_s = 0.5;  // after a gap no more is taken up at once than in this time
constexpr double kRestTime_s = 0.5;     // after which a camera that has not moved stands
constexpr double kMaxSigmas = 3.0;      // by which the estimate may differ from that at rest
constexpr double kNegligible = 1e-9;    // [m] and [rad], of an offset

/// The pose after a translation and rotation along and about the axes of odom.
Eigen::Isometry3d moved(const Eigen::Isometry3d& T_odom_camera, const Vector6d& way) {
  Eigen::Isometry3d T = T_odom_camera;
  T.translation() += way.head<3>();
  const double angle = way.tail<3>().norm();
  if (angle > 0.0) {
    T.linear() = Eigen::AngleAxisd(angle, way.tail<3>() / angle) * T_odom_camera.linear();
  }
  return T;
}

/// A part of a way that is no longer than `most`; [m] or [rad].
Eigen::Vector3d limited(const Eigen::Vector3d& way, double most) {
  const double length = way.norm();
  return length > most ? Eigen::Vector3d(most / length * way) : way;
}

/// Covariance of the last measured motion, along and about the axes of odom.
Matrix6d motionNoise(const PoseIntegrator& estimate) {
  const CameraVelocity& velocity = *estimate.velocity();
  Matrix6d to_odom = Matrix6d::Zero();
  to_odom.topLeftCorner<3, 3>() = to_odom.bottomRightCorner<3, 3>() =
      estimate.T_odom_reference().linear();
  return std::pow(velocity.measured_over_s, 2) * to_odom * velocity.covariance *
         to_odom.transpose();
}

bool isNoise(const Vector6d& way, const Matrix6d& covariance) {
  const double squared = way.dot(covariance.ldlt().solve(way));
  return squared >= 0.0 && squared <= kMaxSigmas * kMaxSigmas;
}

}  // namespace

void SteadyPose::reset(const Eigen::Isometry3d& T_odom_camera) {
  T_odom_camera_ = T_odom_camera;
  offset_.setZero();
  holds_ = false;
  rest_.reset();
}

void SteadyPose::followMeasured(const PoseIntegrator& estimate, double dt_s, bool may_hold) {
  const bool rests = watchRest(estimate, dt_s);
  holds_ = rests && may_hold && (holds_ || isNoise(offset_, 2.0 * motionNoise(estimate)));
  follow(estimate, estimate.twist(), dt_s);
}

void SteadyPose::followPredicted(const PoseIntegrator& estimate, double dt_s) {
  follow(estimate, estimate.twist(), dt_s);
}

void SteadyPose::followUnknown(const PoseIntegrator& estimate, double dt_s) {
  rest_.reset();
  holds_ = false;
  follow(estimate, Vector6d::Zero(), dt_s);
}

Matrix6d SteadyPose::covariance(const PoseIntegrator& estimate) const {
  return estimate.covariance() + offset_ * offset_.transpose();
}

void SteadyPose::follow(const PoseIntegrator& estimate, const Vector6d& velocity, double dt_s) {
  const Eigen::Isometry3d& T_odom_estimate = estimate.T_odom_camera();
  if (holds_) {
    offset_ = poseDifference(T_odom_estimate, T_odom_camera_);
    return;
  }
  const double step_s = std::min(dt_s, kLongestStep_s);
  offset_ *= std::exp(-step_s / kFadeTime_s);
  if (offset_.norm() < kNegligible) offset_.setZero();
  const Eigen::Isometry3d T_odom_wanted = moved(T_odom_estimate, offset_);
  const Eigen::Isometry3d T_odom_moved = T_odom_camera_ * motionAtVelocity(velocity, dt_s);
  const Vector6d beside = poseDifference(T_odom_moved, T_odom_wanted);
  const double most_m = (kBesideShare * velocity.head<3>().norm() + kBesideSpeed) * step_s;
  const double most_rad = (kBesideShare * velocity.tail<3>().norm() + kBesideSpeed) * step_s;
  if (beside.head<3>().norm() <= most_m && beside.tail<3>().norm() <= most_rad) {
    T_odom_camera_ = T_odom_wanted;
    return;
  }
  Vector6d taken;
  taken << limited(beside.head<3>(), most_m), limited(beside.tail<3>(), most_rad);
  T_odom_camera_ = moved(T_odom_moved, taken);
  offset_ = poseDifference(T_odom_estimate, T_odom_camera_);
}

/// True if the camera has been at one place for long enough.
bool SteadyPose::watchRest(const PoseIntegrator& estimate, double dt_s) {
  const Matrix6d noise = motionNoise(estimate);
  if (rest_) {
    const Vector6d way = poseDifference(rest_->T_odom_camera, estimate.T_odom_camera());
    const Matrix6d covariance =
        rest_->noise + noise + estimate.referenceCovariance() - rest_->reference_covariance;
    if (isNoise(way, covariance)) {
      rest_->lasted_s += dt_s;
      return rest_->lasted_s >= kRestTime_s;
    }
  }
  rest_ = Rest{estimate.T_odom_camera(), noise, estimate.referenceCovariance(), 0.0};
  return false;
}

}  // namespace point_line_odometry
