#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <optional>
#include <tuple>

#include "odometry/uncertainty.h"
#include "point_line_odometry/motion_prior.h"
#include "point_line_odometry/parameters.h"
#include "point_line_odometry/tilt_correction.h"
#include "point_line_odometry/types.h"

namespace point_line_odometry {

/// The motion from the previous frame to a later one that did not replace it, as it was tracked by
/// landmarks alone.
struct MotionSincePrevious {
  Eigen::Isometry3d T_previous_camera = Eigen::Isometry3d::Identity();
  Matrix6d covariance = Matrix6d::Zero();  ///< along and about the axes of the previous camera

  auto state() {
    auto& [T, covariance_of_this] = *this;
    return std::tie(T, covariance_of_this);
  }
};

/// Velocity of the camera in its own axes, linear [m/s] and angular [rad/s].
struct CameraVelocity {
  Vector6d value = Vector6d::Zero();
  Matrix6d covariance = Matrix6d::Zero();
  double measured_over_s = 0.0;  ///< time between the two frames that it is from
  std::int64_t stamp_ns = 0;     ///< of the second one
  /// False: from before tracking was lost, or a mean over a time without tracking. It predicts
  /// neither pixels nor poses, but is better than nothing along axes that images do not show.
  bool is_current = true;
  /// Up to the second frame; nothing if that is the previous one.
  std::optional<MotionSincePrevious> since_previous = {};
};

/// An estimated motion since the previous frame.
struct MotionStep {
  Eigen::Isometry3d T_measured = Eigen::Isometry3d::Identity();  ///< previous <- camera
  Eigen::Isometry3d T_previous_camera =
      Eigen::Isometry3d::Identity();       ///< the same with a part of the map's correction
  Matrix6d covariance = Matrix6d::Zero();  ///< along and about the axes of the previous camera
  /// Of the previous frame's pose relative to the landmarks that the motion was estimated with: its
  /// error adds to that of the velocity.
  Matrix6d previous_covariance = Matrix6d::Zero();
  /// Factor of the covariance that is propagated to the next poses. Against a map most of a frame's
  /// error is independent of the next ones: only the landmarks created by it share it.
  double error_correlation = 1.0;
  /// Whether the next poses continue from this one: not if the previous frame remains.
  bool is_propagated = true;
};

/// `T_measured`, moved towards `T_wanted` by at most `max_sigmas` standard deviations of
/// `covariance` (Mahalanobis distance).
Eigen::Isometry3d limitedStep(const Eigen::Isometry3d& T_measured,
                              const Eigen::Isometry3d& T_wanted, const Matrix6d& covariance,
                              double max_sigmas);

/// Pose of the camera in odom with its covariance, and the velocity. An estimated motion is
/// composed with the pose of the previous frame; without one, the pose is predicted from the
/// velocity for a bounded time, and then kept.
class PoseIntegrator {
 public:
  /// Standard deviation of the scale error that remains of calibration and interpolation: it does
  /// not average out along the path. Measured as the path's length over that of the ground truth:
  /// 1.0013 and 1.0032 on KITTI raw 0001 (every frame, every 4th), 0.9995 and 1.0014 on KITTI 06,
  /// 0.9999 and 1.0001 in the rendered town.
  static constexpr double kScaleError = 0.002;

  /// Discards all state; the pose is this one, known exactly.
  void reset(const Eigen::Isometry3d& T_odom_camera);

  /// Continues from another pose, as that of a camera that was moved on its robot; the velocity is
  /// unknown. The covariance is kept, with that of the motion between two frames, which is missing.
  /// \param added to the covariance, along and about the axes of odom.
  void continueAt(const Eigen::Isometry3d& T_odom_camera, const Matrix6d& added);

  /// Continues from the previous frame's pose with an estimated motion. \param dt_s since the
  /// previous frame. \param last_s since the last one, from which the velocity is, if its motion
  /// was estimated.
  void addMeasurement(const MotionStep& step, double dt_s, double last_s, std::int64_t stamp_ns);

  /// Continues from the last pose at the last velocity, with grown covariance. Without a current
  /// velocity a prior that knows the translation suffices. Returns false if there is neither, or if
  /// motions have been predicted for longer than max_prediction_s: then the pose is kept.
  /// \param limits of the camera's speed. \param prior of the motion since the last pose, fused
  /// with the velocity; null: none.
  bool addPrediction(double dt_s, double max_prediction_s, const TrackingParameters& limits,
                     const MotionPrior* prior = nullptr);

  /// Turns the poses by a correction of the tilt about the camera. \param T_correction of it.
  void correctTilt(const Eigen::Isometry3d& T_correction, const TiltCorrection& correction);

  /// The last pose becomes that of the previous frame.
  void advance();

  /// Tracking was lost: the velocity is no longer the current one.
  void loseVelocity();

  /// The velocity is a mean over so long a time that the present one may differ much.
  void widenVelocity();

  /// An earlier frame becomes the previous one again, with the pose and covariance that it had.
  void returnTo(const Eigen::Isometry3d& T_odom_previous, const Matrix6d& previous_covariance);

  const Eigen::Isometry3d& T_odom_camera() const { return T_odom_camera_; }
  const Eigen::Isometry3d& T_odom_previous() const { return T_odom_previous_; }

  /// Along and about the axes of odom; since reset().
  Matrix6d covariance() const;

  /// The part of it that is propagated from the previous frame, without the scale error.
  const Matrix6d& previousCovariance() const { return previous_covariance_; }

  /// The last estimated velocity, current or not; none before two frames were matched.
  const std::optional<CameraVelocity>& velocity() const { return velocity_; }

  /// For how long motions have been predicted [s]; 0 if the last one was estimated.
  double predictedTime() const { return predicted_s_; }

  /// Of the motions predicted since the last estimated one, along and about the axes of odom.
  Matrix6d predictedCovariance() const { return predicted_error_ * predicted_error_.transpose(); }

  /// Of the last estimated motion, as it is propagated to the next poses; along and about the axes
  /// of odom.
  const Matrix6d& stepCovariance() const { return step_covariance_; }

  /// Velocity at the last pose: estimated, predicted with grown covariance, or zero while the pose
  /// is kept.
  const Vector6d& twist() const { return twist_; }
  const Matrix6d& twistCovariance() const { return twist_covariance_; }

  /// All members, for StereoOdometry::saveState().
  auto state() {
    auto& [T_odom_camera, start, covariance, error_correlation, T_odom_previous,
           previous_covariance, velocity, twist, twist_covariance, predicted_error, predicted_s,
           step_covariance] = *this;
    return std::tie(T_odom_camera, start, covariance, error_correlation, T_odom_previous,
                    previous_covariance, velocity, twist, twist_covariance, predicted_error,
                    predicted_s, step_covariance);
  }

 private:
  void setVelocity(const MotionStep& step, double dt_s, double last_s, std::int64_t stamp_ns);
  void addPredictedError(const PredictedMotion& motion);

  Eigen::Isometry3d T_odom_camera_ = Eigen::Isometry3d::Identity();
  Eigen::Vector3d start_ = Eigen::Vector3d::Zero();    // where the pose was known exactly
  Matrix6d covariance_ = Matrix6d::Zero();             // without the scale error
  Matrix6d correlated_covariance_ = Matrix6d::Zero();  // what is propagated to the next poses
  Eigen::Isometry3d T_odom_previous_ = Eigen::Isometry3d::Identity();
  Matrix6d previous_covariance_ = Matrix6d::Zero();  // what it propagates
  std::optional<CameraVelocity> velocity_;
  Vector6d twist_ = Vector6d::Zero();
  Matrix6d twist_covariance_ = Matrix6d::Zero();
  /// Error of the pose since the last estimated motion, along and about the axes of odom: a column
  /// for one standard deviation of each axis of the velocity.
  Matrix6d predicted_error_ = Matrix6d::Zero();
  double predicted_s_ = 0.0;  // time since then
  Matrix6d step_covariance_ = Matrix6d::Zero();
};

}  // namespace point_line_odometry
