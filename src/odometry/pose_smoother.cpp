#include "odometry/pose_smoother.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

#include "odometry/uncertainty.h"

namespace point_line_odometry {
namespace {

// Correction rate: how fast the pose may move in addition to the estimated motion, so that
// controllers stay stable.
constexpr double kCorrectionShare = 0.2;  // of the camera's own speed
constexpr double kCorrectionSpeed = 0.1;  // [m/s] and [rad/s], of a stationary camera

constexpr double kFadeTime_s = 0.5;        // time constant of the offset's decay
constexpr double kLongestStep_s = 0.5;     // limits the correction after a gap
constexpr double kStationaryTime_s = 0.5;  // without motion, to be stationary
constexpr double kMaxSigmas = 3.0;         // of the estimate from where it became stationary
constexpr double kPredictedSigmas = 1.0;   // the same of a prediction: wheels at rest have no noise
constexpr double kMovesSigmas = 6.0;       // of a velocity that no stationary camera has
constexpr double kNegligible = 1e-9;       // [m] and [rad], of an offset

/// A translation or rotation vector shortened to at most `most` [m] or [rad].
Eigen::Vector3d limited(const Eigen::Vector3d& difference, double most) {
  const double length = difference.norm();
  return length > most ? Eigen::Vector3d(most / length * difference) : difference;
}

/// Covariance of the last estimated motion, along and about the axes of odom.
Matrix6d motionNoise(const PoseIntegrator& estimate) {
  const CameraVelocity& velocity = *estimate.velocity();
  const Matrix6d to_odom = blockRotation(estimate.T_odom_previous().linear());
  return std::pow(velocity.measured_over_s, 2) * to_odom * velocity.covariance *
         to_odom.transpose();
}

bool isNoise(const Vector6d& difference, const Matrix6d& covariance, double max_sigmas) {
  const double squared = difference.dot(covariance.ldlt().solve(difference));
  return squared >= 0.0 && squared <= max_sigmas * max_sigmas;
}

}  // namespace

void PoseSmoother::reset(const Eigen::Isometry3d& T_odom_camera) {
  T_odom_camera_ = T_odom_camera;
  offset_.setZero();
  holds_ = false;
  stationary_.reset();
}

void PoseSmoother::followMeasured(const PoseIntegrator& estimate, double dt_s, bool may_hold) {
  const bool is_stationary = updateStationary(estimate, dt_s);
  holds_ = is_stationary && may_hold &&
           (holds_ || isNoise(offset_, 2.0 * motionNoise(estimate), kMaxSigmas));
  follow(estimate, estimate.twist(), dt_s);
}

void PoseSmoother::followPredicted(const PoseIntegrator& estimate, double dt_s) {
  if (holds_ && moves(estimate)) {
    stationary_.reset();
    holds_ = false;
  }
  follow(estimate, estimate.twist(), dt_s);
}

void PoseSmoother::followUnknown(const PoseIntegrator& estimate, const Vector6d& velocity,
                                 double dt_s) {
  stationary_.reset();
  holds_ = false;
  follow(estimate, velocity, dt_s);
}

void PoseSmoother::followCorrection(const PoseIntegrator& estimate,
                                    const Eigen::Isometry3d& T_correction) {
  if (stationary_) stationary_->T_odom_camera = T_correction * stationary_->T_odom_camera;
  offset_ = poseDifference(estimate.T_odom_camera(), T_odom_camera_);
}

bool PoseSmoother::isStationary() const {
  return stationary_ && stationary_->lasted_s >= kStationaryTime_s;
}

Matrix6d PoseSmoother::covariance(const PoseIntegrator& estimate) const {
  return estimate.covariance() + offsetCovariance();
}

void PoseSmoother::follow(const PoseIntegrator& estimate, const Vector6d& velocity, double dt_s) {
  const Eigen::Isometry3d& T_odom_estimate = estimate.T_odom_camera();
  if (holds_) {
    offset_ = poseDifference(T_odom_estimate, T_odom_camera_);
    return;
  }
  const double step_s = std::min(dt_s, kLongestStep_s);
  offset_ *= std::exp(-step_s / kFadeTime_s);
  if (offset_.norm() < kNegligible) offset_.setZero();
  const Eigen::Isometry3d T_odom_wanted = addPoseDifference(T_odom_estimate, offset_);
  const Eigen::Isometry3d T_odom_moved = T_odom_camera_ * motionAtVelocity(velocity, dt_s);
  const Vector6d correction = poseDifference(T_odom_moved, T_odom_wanted);
  const double most_m = (kCorrectionShare * velocity.head<3>().norm() + kCorrectionSpeed) * step_s;
  const double most_rad =
      (kCorrectionShare * velocity.tail<3>().norm() + kCorrectionSpeed) * step_s;
  if (correction.head<3>().norm() <= most_m && correction.tail<3>().norm() <= most_rad) {
    T_odom_camera_ = T_odom_wanted;
    return;
  }
  Vector6d taken;
  taken << limited(correction.head<3>(), most_m), limited(correction.tail<3>(), most_rad);
  T_odom_camera_ = addPoseDifference(T_odom_moved, taken);
  offset_ = poseDifference(T_odom_estimate, T_odom_camera_);
}

/// True if the camera has not moved for long enough. Where its position is hardly known, as after a
/// loss, poses far from it are within its noise, too: then the velocity shows the motion.
bool PoseSmoother::updateStationary(const PoseIntegrator& estimate, double dt_s) {
  const CameraVelocity& velocity = *estimate.velocity();
  if (!isNoise(velocity.value, velocity.covariance, kMovesSigmas)) {
    stationary_.reset();
    return false;
  }
  const Matrix6d noise = motionNoise(estimate);
  if (stationary_) {
    const Vector6d difference =
        poseDifference(stationary_->T_odom_camera, estimate.T_odom_camera());
    const Matrix6d covariance = stationary_->noise + noise + stationary_->steps;
    stationary_->steps += estimate.stepCovariance();
    if (isNoise(difference, covariance, kMaxSigmas)) {
      stationary_->lasted_s += dt_s;
      return isStationary();
    }
  }
  stationary_ = Stationary{estimate.T_odom_camera(), noise, estimate.stepCovariance(), 0.0};
  return false;
}

/// Whether the predicted pose has left the place where the camera became stationary.
bool PoseSmoother::moves(const PoseIntegrator& estimate) const {
  if (!stationary_) return false;
  const Vector6d difference = poseDifference(stationary_->T_odom_camera, estimate.T_odom_camera());
  const Matrix6d covariance =
      stationary_->noise + stationary_->steps + estimate.predictedCovariance();
  return !isNoise(difference, covariance, kPredictedSigmas);
}

}  // namespace point_line_odometry
