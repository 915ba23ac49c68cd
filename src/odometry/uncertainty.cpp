#include "odometry/uncertainty.h"

#include <cmath>

#include "motion/prior_factor.h"

namespace point_line_odometry {
namespace {

// Standard deviation of a robot's acceleration, by which a predicted velocity becomes uncertain.
constexpr double kAcceleration = 3.0;         // [m/s^2]
constexpr double kAngularAcceleration = 3.0;  // [rad/s^2]

}  // namespace

Eigen::Isometry3d motionAtVelocity(const Vector6d& velocity, double dt_s) {
  Eigen::Isometry3d T_prev_curr = Eigen::Isometry3d::Identity();
  const Eigen::Vector3d rotation = velocity.tail<3>() * dt_s;
  T_prev_curr.linear() = expSO3(rotation);
  // The camera rotates while it moves: its mean axes are those of half the rotation.
  T_prev_curr.translation() = expSO3(0.5 * rotation) * velocity.head<3>() * dt_s;
  return T_prev_curr;
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

Matrix6d covarianceBetween(const Eigen::Isometry3d& T_begin_last, const Matrix6d& last,
                           const Matrix6d& curr) {
  const Matrix6d to_last = blockRotation(T_begin_last.linear().transpose());
  return to_last * (last + curr) * to_last.transpose();
}

PredictedMotion predictedMotion(const Vector6d& velocity, const Matrix6d& covariance, double dt_s,
                                const MotionPrior* prior) {
  if (prior == nullptr) return {motionAtVelocity(velocity, dt_s), covariance};
  // In the camera's mean axes, in which a velocity is.
  const Matrix6d to_prev = blockRotation(expSO3(0.5 * logSO3(prior->T_prev_curr.linear())));
  const Matrix6d information = dt_s * dt_s * to_prev.transpose() * prior->information * to_prev;
  const Matrix6d fused = fusedCovariance(covariance / (dt_s * dt_s), information);
  const Vector6d by_prior = velocityOfMotion(prior->T_prev_curr, dt_s);
  const Vector6d mean = velocity + fused * (information * (by_prior - velocity));
  return {motionAtVelocity(mean, dt_s), dt_s * dt_s * to_prev * fused * to_prev.transpose()};
}

}  // namespace point_line_odometry
