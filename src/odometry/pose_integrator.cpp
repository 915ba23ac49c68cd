#include "point_line_odometry/pose_integrator.h"

#include "odometry/uncertainty.h"

namespace point_line_odometry {

void PoseIntegrator::reset(const Eigen::Isometry3d& T_odom_camera) {
  T_odom_camera_ = T_odom_reference_ = T_odom_camera;
  covariance_ = reference_covariance_ = Matrix6d::Zero();
  velocity_.reset();
  twist_.setZero();
  twist_covariance_.setZero();
}

void PoseIntegrator::addMeasurement(const Eigen::Isometry3d& T_reference_camera,
                                    const Matrix6d& covariance, double dt_s,
                                    std::int64_t stamp_ns) {
  covariance_ =
      composeCovariance(T_odom_reference_, reference_covariance_, T_reference_camera, covariance);
  T_odom_camera_ = T_odom_reference_ * T_reference_camera;
  T_odom_camera_.linear() =
      Eigen::Quaterniond(T_odom_camera_.linear()).normalized().toRotationMatrix();
  velocity_ = CameraVelocity{velocityOfMotion(T_reference_camera, dt_s), covariance / (dt_s * dt_s),
                             dt_s, stamp_ns};
  twist_ = velocity_->value;
  twist_covariance_ = velocity_->covariance;
}

bool PoseIntegrator::addPrediction(double dt_s, std::int64_t stamp_ns, double max_prediction_s) {
  const double unmeasured_s =
      velocity_ ? 1e-9 * static_cast<double>(stamp_ns - velocity_->stamp_ns) : dt_s;
  const bool moves = velocity_ && unmeasured_s <= max_prediction_s;
  const Vector6d velocity = velocity_ ? velocity_->value : Vector6d::Zero();
  const Eigen::Isometry3d T_prev_curr =
      moves ? motionAtVelocity(velocity, dt_s) : Eigen::Isometry3d::Identity();
  const Matrix6d motion_covariance = predictionCovariance(velocity, moves, dt_s, unmeasured_s);
  covariance_ = composeCovariance(T_odom_camera_, covariance_, T_prev_curr, motion_covariance);
  T_odom_camera_ = T_odom_camera_ * T_prev_curr;
  twist_ = moves ? velocity : Vector6d::Zero();
  twist_covariance_ = motion_covariance / (dt_s * dt_s);
  return moves;
}

void PoseIntegrator::takeReference() {
  T_odom_reference_ = T_odom_camera_;
  reference_covariance_ = covariance_;
}

}  // namespace point_line_odometry
