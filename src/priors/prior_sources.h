#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <deque>
#include <optional>

#include "point_line_odometry/frame_result.h"
#include "point_line_odometry/gravity.h"
#include "point_line_odometry/gyroscope.h"
#include "point_line_odometry/motion_prior.h"
#include "point_line_odometry/parameters.h"
#include "point_line_odometry/tilt_correction.h"
#include "point_line_odometry/wheel_odometry.h"

namespace point_line_odometry {

/// All that tells of a camera's motion without its images: gyroscope and accelerometer of an IMU,
/// wheels and the flat floor, as far as the parameters enable them, each by where it is in the
/// base. What a frame gets depends on the stamps of samples and frames, not on the order in which
/// samples arrive. Memory is bounded. Deterministic; not thread-safe.
class PriorSources {
 public:
  explicit PriorSources(const Parameters& parameters) : parameters_(parameters) {}

  /// Where the rectified left camera is in the base. Until that is known samples wait.
  void setCamera(const Eigen::Isometry3d& T_base_camera);

  /// Takes a sample of the IMU. \param T_base_imu its pose in the base.
  void addImu(const ImuSample& sample, const Eigen::Isometry3d& T_base_imu);

  /// True if further samples do not change the prior of a frame, or there is no IMU in use.
  bool hasImuUntil(std::int64_t stamp_ns) const;

  /// Takes a pose by wheels. \param T_base_body pose in the base of the frame that it is of.
  void addWheels(const OdometrySample& sample, const Eigen::Isometry3d& T_base_body);

  /// True if further poses do not change the prior of a frame, or there are no wheels in use.
  bool hasWheelsUntil(std::int64_t stamp_ns) const;

  /// The motion from the last frame that the odometry accepted until the next one by all sources
  /// together; nothing if none of them knows it. To be called once for a frame.
  std::optional<MotionPrior> takePrior(std::int64_t from_ns, std::int64_t to_ns);

  /// As Gravity::takeCorrection().
  std::optional<TiltCorrection> takeTiltCorrection();

  /// Compares the sources with the images of a frame, and estimates what is calibrated of them.
  void update(const FrameResult& result);

  /// Discards the samples, for a clock that jumped; what was estimated is kept.
  void discardSamples();

  /// For an odometry that was reset: odom has other axes.
  void restartGravity();

  /// For an odometry that goes on in the same axes of odom after a gap.
  void continueGravity();

  /// Takes other parameters; what was estimated by a source that stays in use is kept.
  void setParameters(const Parameters& parameters);

  /// The sources in use; null: it is not.
  const Gyroscope* gyroscope() const { return gyroscope_ ? &*gyroscope_ : nullptr; }
  const Gravity* gravity() const { return gravity_ ? &*gravity_ : nullptr; }
  const WheelOdometry* wheels() const { return wheels_ ? &*wheels_ : nullptr; }
  const PlanarFloor* floor() const { return floor_ ? &*floor_ : nullptr; }

  /// Numbers of successive frames for which the IMU, or the wheels, gave nothing: samples come that
  /// are not of the time of the images, or are too few.
  int framesWithoutImu() const { return without_imu_; }
  int framesWithoutWheels() const { return without_wheels_; }

 private:
  void startImu();
  void mountImu();
  void startGravity();
  Eigen::Isometry3d T_camera_imu() const { return T_base_camera_->inverse() * *T_base_imu_; }
  void startWheels();
  void startFloor();

  Parameters parameters_;
  std::optional<Eigen::Isometry3d> T_base_camera_;
  std::optional<Eigen::Isometry3d> T_base_imu_;
  std::optional<Eigen::Isometry3d> T_base_body_;  // of the wheels
  std::optional<Gyroscope> gyroscope_;
  std::optional<Gravity> gravity_;           // only with a gyroscope
  std::deque<ImuSample> early_imu_samples_;  // before there was one
  std::optional<WheelOdometry> wheels_;
  std::deque<OdometrySample> early_wheel_samples_;
  std::optional<PlanarFloor> floor_;
  int without_imu_ = 0;
  int without_wheels_ = 0;
};

}  // namespace point_line_odometry
