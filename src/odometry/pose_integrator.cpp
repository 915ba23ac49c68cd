#include "odometry/pose_integrator.h"

#include <Eigen/Cholesky>
#include <cmath>

#include "geometry/se3.h"
#include "motion/prior_factor.h"
#include "odometry/motion_prediction.h"
#include "odometry/tilt.h"
#include "odometry/uncertainty.h"

namespace point_line_odometry {

Eigen::Isometry3d limitedStep(const Eigen::Isometry3d& T_measured,
                              const Eigen::Isometry3d& T_wanted, const Matrix6d& covariance,
                              double max_sigmas) {
  // Difference of the wanted from the measured step, along and about the axes of the previous
  // frame.
  const Eigen::Isometry3d T_measured_wanted = T_measured.inverse() * T_wanted;
  const Eigen::AngleAxisd rotation(T_measured_wanted.linear());
  Vector6d correction;
  correction << T_measured.linear() * T_measured_wanted.translation(),
      T_measured.linear() * (rotation.angle() * rotation.axis());
  const double squared = correction.dot(covariance.ldlt().solve(correction));
  const double share = squared > max_sigmas * max_sigmas ? max_sigmas / std::sqrt(squared) : 1.0;
  if (!(share > 0.0)) return T_measured;
  Eigen::Isometry3d T_correction = Eigen::Isometry3d::Identity();
  T_correction.linear() =
      Eigen::AngleAxisd(share * rotation.angle(), rotation.axis()).toRotationMatrix();
  T_correction.translation() = share * T_measured_wanted.translation();
  return T_measured * T_correction;
}

void PoseIntegrator::reset(const Eigen::Isometry3d& T_odom_camera) {
  *this = PoseIntegrator();
  T_odom_camera_ = T_odom_previous_ = T_odom_camera;
  start_ = T_odom_camera.translation();
}

void PoseIntegrator::continueAt(const Eigen::Isometry3d& T_odom_camera, const Matrix6d& added) {
  Matrix6d missed = Matrix6d::Zero();
  if (velocity_) {
    const double dt_s = velocity_->measured_over_s;
    missed = predictionCovariance(velocity_->value, false, dt_s, dt_s);
  }
  const Eigen::Isometry3d T_before_camera = T_odom_camera_.inverse() * T_odom_camera;
  const auto composed = [&](const Matrix6d& covariance) {
    return composeCovariance(T_odom_camera_, covariance + added, T_before_camera, missed);
  };
  PoseIntegrator next;
  next.T_odom_camera_ = T_odom_camera;
  next.start_ = start_;
  next.covariance_ = composed(covariance_);
  next.correlated_covariance_ = composed(correlated_covariance_);
  next.advance();
  *this = next;
}

void PoseIntegrator::addMeasurement(const MotionStep& step, double dt_s, double last_s,
                                    std::int64_t stamp_ns) {
  const auto composed = [&](const Matrix6d& covariance) {
    return composeCovariance(T_odom_previous_, previous_covariance_, step.T_previous_camera,
                             covariance);
  };
  correlated_covariance_ = composed(step.error_correlation * step.covariance);
  const Matrix6d to_odom = blockRotation(T_odom_previous_.linear());
  const double propagated = step.is_propagated ? step.error_correlation : 0.0;
  step_covariance_ = propagated * to_odom * step.covariance * to_odom.transpose();
  covariance_ = composed(step.covariance);
  T_odom_camera_ = T_odom_previous_ * step.T_previous_camera;
  T_odom_camera_.linear() =
      Eigen::Quaterniond(T_odom_camera_.linear()).normalized().toRotationMatrix();
  setVelocity(step, dt_s, last_s, stamp_ns);
  twist_ = velocity_->value;
  twist_covariance_ = velocity_->covariance;
  predicted_error_.setZero();
  predicted_s_ = 0.0;
}

/// Since the last frame, if its motion was estimated, else since the previous one.
void PoseIntegrator::setVelocity(const MotionStep& step, double dt_s, double last_s,
                                 std::int64_t stamp_ns) {
  Eigen::Isometry3d T_begin_camera = step.T_measured;
  Matrix6d covariance = step.covariance + step.previous_covariance;
  double over_s = dt_s;
  if (velocity_ && velocity_->since_previous && predicted_s_ == 0.0) {
    const MotionSincePrevious& last = *velocity_->since_previous;
    T_begin_camera = last.T_previous_camera.inverse() * step.T_measured;
    covariance = covarianceBetween(last.T_previous_camera, last.covariance, step.covariance);
    over_s = last_s;
  }
  const Eigen::Vector3d translation = T_begin_camera.translation();
  covariance.topLeftCorner<3, 3>() +=
      kScaleError * kScaleError * translation * translation.transpose();
  velocity_ = CameraVelocity{velocityOfMotion(T_begin_camera, over_s),
                             covariance / (over_s * over_s),
                             over_s,
                             stamp_ns,
                             true,
                             MotionSincePrevious{step.T_measured, step.covariance}};
}

bool PoseIntegrator::addPrediction(double dt_s, double max_prediction_s,
                                   const TrackingParameters& limits, const MotionPrior* prior) {
  predicted_s_ += dt_s;
  const bool moves = predicted_s_ <= max_prediction_s &&
                     (isCurrent(velocity_) || (prior != nullptr && knowsTranslation(*prior)));
  PredictedMotion motion;
  if (moves) {
    motion = predictStep(velocity_, dt_s, predicted_s_, limits, prior);
  } else {
    motion.covariance = covarianceOfUnknownMotion(velocity_, dt_s, predicted_s_, limits);
  }
  addPredictedError(motion);
  T_odom_camera_ = T_odom_camera_ * motion.T_prev_curr;
  twist_.setZero();
  if (moves) twist_ = prior ? velocityOfMotion(motion.T_prev_curr, dt_s) : velocity_->value;
  twist_covariance_ = motion.covariance / (dt_s * dt_s);
  return moves;
}

/// The error of a velocity is constant in the camera's axes: errors of successive predictions add
/// up, not their variances, and that of the rotation turns the way that follows.
void PoseIntegrator::addPredictedError(const PredictedMotion& motion) {
  const Eigen::Matrix3d& R = T_odom_camera_.linear();
  Matrix6d error = predicted_error_;
  error.topRows<3>() -= skew(R * motion.T_prev_curr.translation()) * error.bottomRows<3>();
  const Vector6d deviations = motion.covariance.diagonal().cwiseSqrt();
  predicted_error_ = error + blockRotation(R) * deviations.asDiagonal();
  for (int i = 3; i < 6; ++i) {  // an angle is not more uncertain than by half a turn
    const double angle = predicted_error_.row(i).norm();
    if (angle > M_PI) predicted_error_.row(i) *= M_PI / angle;
  }
  covariance_ = correlated_covariance_ =
      composeCovariance(T_odom_camera_, covariance_, motion.T_prev_curr, Matrix6d::Zero()) +
      predicted_error_ * predicted_error_.transpose() - error * error.transpose();
}

Matrix6d PoseIntegrator::covariance() const {
  Matrix6d covariance = covariance_;
  const Eigen::Vector3d translation = T_odom_camera_.translation() - start_;
  covariance.topLeftCorner<3, 3>() +=
      kScaleError * kScaleError * translation * translation.transpose();
  return covariance;
}

void PoseIntegrator::loseVelocity() {
  if (velocity_) velocity_->is_current = false;
}

void PoseIntegrator::widenVelocity() {
  if (!velocity_) return;
  velocity_->is_current = false;
  // Of a steady acceleration, the mean velocity is that of the middle of the time.
  velocity_->covariance +=
      predictionCovariance(Vector6d::Zero(), true, 1.0, 0.5 * velocity_->measured_over_s);
  twist_covariance_ = velocity_->covariance;
}

void PoseIntegrator::returnTo(const Eigen::Isometry3d& T_odom_previous,
                              const Matrix6d& previous_covariance) {
  if (velocity_) velocity_->since_previous.reset();
  T_odom_previous_ = T_odom_previous;
  previous_covariance_ = previous_covariance;
}

void PoseIntegrator::correctTilt(const Eigen::Isometry3d& T_correction,
                                 const TiltCorrection& correction) {
  T_odom_camera_ = T_correction * T_odom_camera_;
  T_odom_previous_ = T_correction * T_odom_previous_;
  for (Matrix6d* covariance : {&covariance_, &correlated_covariance_, &previous_covariance_})
    *covariance = correctedCovariance(*covariance, correction);
  predicted_error_.setZero();  // it is less than that now
}

void PoseIntegrator::advance() {
  if (velocity_) velocity_->since_previous.reset();
  T_odom_previous_ = T_odom_camera_;
  previous_covariance_ = correlated_covariance_;
}

}  // namespace point_line_odometry
