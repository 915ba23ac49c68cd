#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <optional>
#include <tuple>

#include "point_line_odometry/types.h"

namespace point_line_odometry {

/// Velocity of the camera in its own axes, linear [m/s] and angular [rad/s].
struct CameraVelocity {
  Vector6d value = Vector6d::Zero();
  Matrix6d covariance = Matrix6d::Zero();
  double measured_over_s = 0.0;  ///< time between the two frames that it comes from
  std::int64_t stamp_ns = 0;     ///< of the second one
};

/// A measured motion since the reference.
struct MotionStep {
  Eigen::Isometry3d T_measured = Eigen::Isometry3d::Identity();  ///< reference <- camera
  Eigen::Isometry3d T_reference_camera =
      Eigen::Isometry3d::Identity();       ///< the same with what earlier frames were corrected by
  Matrix6d covariance = Matrix6d::Zero();  ///< along and about the axes of the reference
  /// Of the reference's own pose against the landmarks that the motion was measured with: the
  /// velocity has its error, too.
  Matrix6d reference_covariance = Matrix6d::Zero();
  /// How many times the covariance is handed on to the next poses. Against a map a frame's error is
  /// its own, only the landmarks made with it keep it.
  double lasting = 1.0;
};

/// `T_measured`, moved towards `T_wanted` as far as so many standard deviations of its covariance.
Eigen::Isometry3d limitedStep(const Eigen::Isometry3d& T_measured,
                              const Eigen::Isometry3d& T_wanted, const Matrix6d& covariance,
                              double max_sigmas);

/// Pose of the camera in odom with its covariance, and the velocity: what is known between frames.
/// A measured motion starts at the reference frame; without one, the velocity carries the pose on
/// for a bounded time, and then it is held.
class PoseIntegrator {
 public:
  /// What calibration and interpolation leave of a scale error, as a share of lengths: it does not
  /// average out on the way.
  static constexpr double kScaleError = 0.002;

  /// Forgets the past; the pose is this one, known exactly.
  void reset(const Eigen::Isometry3d& T_odom_camera);

  /// Continues from the reference's pose with a measured motion.
  void addMeasurement(const MotionStep& step, double dt_s, std::int64_t stamp_ns);

  /// Continues from the last pose at the last velocity, with grown covariance. Returns false if the
  /// velocity is unknown or was measured longer than max_prediction_s ago: then the pose is held.
  bool addPrediction(double dt_s, std::int64_t stamp_ns, double max_prediction_s);

  /// The last pose becomes that of the reference.
  void takeReference();

  void forgetVelocity() { velocity_.reset(); }

  /// The last measured motion took so long that its velocity says little about the present one.
  void forgetMeasuredVelocity();

  /// The reference becomes an earlier one again, with the pose and covariance that it had.
  void returnTo(const Eigen::Isometry3d& T_odom_reference, const Matrix6d& reference_covariance);

  const Eigen::Isometry3d& T_odom_camera() const { return T_odom_camera_; }
  const Eigen::Isometry3d& T_odom_reference() const { return T_odom_reference_; }

  /// Along and about the axes of odom; since reset().
  Matrix6d covariance() const;

  /// The part of it that the reference has handed on, without the scale's error.
  const Matrix6d& referenceCovariance() const { return reference_covariance_; }

  /// The last measured velocity; none before two frames were matched.
  const std::optional<CameraVelocity>& velocity() const { return velocity_; }

  /// Velocity at the last pose: measured, carried on with grown covariance, or zero while the pose
  /// is held.
  const Vector6d& twist() const { return twist_; }
  const Matrix6d& twistCovariance() const { return twist_covariance_; }

  /// All members, for StereoOdometry::saveState().
  auto state() {
    auto& [T_odom_camera, start, covariance, lasting, T_odom_reference, reference_covariance,
           velocity, twist, twist_covariance, predicted_error] = *this;
    return std::tie(T_odom_camera, start, covariance, lasting, T_odom_reference,
                    reference_covariance, velocity, twist, twist_covariance, predicted_error);
  }

 private:
  Eigen::Isometry3d T_odom_camera_ = Eigen::Isometry3d::Identity();
  Eigen::Vector3d start_ = Eigen::Vector3d::Zero();  // where the pose was known exactly
  Matrix6d covariance_ = Matrix6d::Zero();           // without the scale's error
  Matrix6d lasting_covariance_ = Matrix6d::Zero();   // the part that is handed on
  Eigen::Isometry3d T_odom_reference_ = Eigen::Isometry3d::Identity();
  Matrix6d reference_covariance_ = Matrix6d::Zero();  // what the reference has handed on
  std::optional<CameraVelocity> velocity_;
  Vector6d twist_ = Vector6d::Zero();
  Matrix6d twist_covariance_ = Matrix6d::Zero();
  Vector6d predicted_error_ = Vector6d::Zero();  // of the pose since the last measurement
};

}  // namespace point_line_odometry
