#include "point_line_odometry/pose_integrator.h"

#include <Eigen/Cholesky>
#include <cmath>

#include "odometry/uncertainty.h"

namespace point_line_odometry {

Eigen::Isometry3d limitedStep(const Eigen::Isometry3d& T_measured,
                              const Eigen::Isometry3d& T_wanted, const Matrix6d& covariance,
                              double max_sigmas) {
  // What is wanted beyond what was measured, along and about the axes of the reference.
  const Eigen::Isometry3d T_measured_wanted = T_measured.inverse() * T_wanted;
  const Eigen::AngleAxisd turn(T_measured_wanted.linear());
  Vector6d change;
  change << T_measured.linear() * T_measured_wanted.translation(),
      T_measured.linear() * (turn.angle() * turn.axis());
  const double squared = change.dot(covariance.ldlt().solve(change));
  const double share = squared > max_sigmas * max_sigmas ? max_sigmas / std::sqrt(squared) : 1.0;
  if (!(share > 0.0)) return T_measured;
  Eigen::Isometry3d T_change = Eigen::Isometry3d::Identity();
  T_change.linear() = Eigen::AngleAxisd(share * turn.angle(), turn.axis()).toRotationMatrix();
  T_change.translation() = share * T_measured_wanted.translation();
  return T_measured * T_change;
}

void PoseIntegrator::reset(const Eigen::Isometry3d& T_odom_camera) {
  T_odom_camera_ = T_odom_reference_ = T_odom_camera;
  start_ = T_odom_camera.translation();
  covariance_ = lasting_covariance_ = reference_covariance_ = Matrix6d::Zero();
  velocity_.reset();
  twist_.setZero();
  twist_covariance_.setZero();
  predicted_error_.setZero();
}

void PoseIntegrator::addMeasurement(const MotionStep& step, double dt_s, std::int64_t stamp_ns) {
  const auto composed = [&](const Matrix6d& covariance) {
    return composeCovariance(T_odom_reference_, reference_covariance_, step.T_reference_camera,
                             covariance);
  };
  lasting_covariance_ = composed(step.lasting * step.covariance);
  covariance_ = composed(step.covariance);
  T_odom_camera_ = T_odom_reference_ * step.T_reference_camera;
  T_odom_camera_.linear() =
      Eigen::Quaterniond(T_odom_camera_.linear()).normalized().toRotationMatrix();
  Matrix6d covariance = step.covariance + step.reference_covariance;
  const Eigen::Vector3d way = step.T_measured.translation();
  covariance.topLeftCorner<3, 3>() += kScaleError * kScaleError * way * way.transpose();
  velocity_ = CameraVelocity{velocityOfMotion(step.T_measured, dt_s), covariance / (dt_s * dt_s),
                             dt_s, stamp_ns};
  twist_ = velocity_->value;
  twist_covariance_ = velocity_->covariance;
  predicted_error_.setZero();
}

bool PoseIntegrator::addPrediction(double dt_s, std::int64_t stamp_ns, double max_prediction_s) {
  const double unmeasured_s = velocity_ ? toSeconds(stamp_ns - velocity_->stamp_ns) : dt_s;
  const bool moves = velocity_ && unmeasured_s <= max_prediction_s;
  const Vector6d velocity = velocity_ ? velocity_->value : Vector6d::Zero();
  const Eigen::Isometry3d T_prev_curr =
      moves ? motionAtVelocity(velocity, dt_s) : Eigen::Isometry3d::Identity();
  const Matrix6d motion_covariance = predictionCovariance(velocity, moves, dt_s, unmeasured_s);
  // A velocity that is wrong is so all the time: its errors add up, not their squares.
  const Vector6d error = motion_covariance.diagonal().cwiseSqrt();
  Vector6d predicted = predicted_error_ + error;
  predicted.head<3>().array() +=
      predicted_error_.tail<3>().norm() * T_prev_curr.translation().norm();
  const Matrix6d grown =
      Vector6d(predicted.cwiseAbs2() - predicted_error_.cwiseAbs2()).asDiagonal();
  predicted_error_ = predicted;
  covariance_ = lasting_covariance_ =
      composeCovariance(T_odom_camera_, covariance_, T_prev_curr, grown);
  T_odom_camera_ = T_odom_camera_ * T_prev_curr;
  twist_ = moves ? velocity : Vector6d::Zero();
  twist_covariance_ = motion_covariance / (dt_s * dt_s);
  return moves;
}

Matrix6d PoseIntegrator::covariance() const {
  Matrix6d covariance = covariance_;
  const Eigen::Vector3d way = T_odom_camera_.translation() - start_;
  covariance.topLeftCorner<3, 3>() += kScaleError * kScaleError * way * way.transpose();
  return covariance;
}

void PoseIntegrator::forgetMeasuredVelocity() {
  if (!velocity_) return;
  twist_covariance_ =
      predictionCovariance(velocity_->value, false, 1.0, velocity_->measured_over_s);
  twist_.setZero();
  velocity_.reset();
}

void PoseIntegrator::returnTo(const Eigen::Isometry3d& T_odom_reference,
                              const Matrix6d& reference_covariance) {
  T_odom_reference_ = T_odom_reference;
  reference_covariance_ = reference_covariance;
}

void PoseIntegrator::takeReference() {
  T_odom_reference_ = T_odom_camera_;
  reference_covariance_ = lasting_covariance_;
}

}  // namespace point_line_odometry
