#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <optional>
#include <vector>

#include "point_line_odometry/frame_result.h"
#include "point_line_odometry/gyroscope.h"
#include "point_line_odometry/parameters.h"
#include "point_line_odometry/tilt_correction.h"

namespace point_line_odometry {

/// Windows of frames by what became of their measurement of gravity.
struct GravityUse {
  std::size_t used = 0;         ///< taken by the filter
  std::size_t not_gravity = 0;  ///< not of gravity's length, or too uncertain by vibration
  std::size_t rejected = 0;     ///< they disagree with the expected direction
  std::size_t restarts = 0;     ///< too many in a row did: the direction was measured again
};

/// What is estimated of gravity and the accelerometer, with standard deviations.
struct GravityCalibration {
  bool known = false;                                    ///< false before the first measurement
  Eigen::Vector3d up = Eigen::Vector3d::UnitZ();         ///< opposite to gravity, in odom
  Eigen::Vector3d bias = Eigen::Vector3d::Zero();        ///< in the axes of the IMU [m/s^2]
  Eigen::Vector3d bias_sigma = Eigen::Vector3d::Zero();  ///< of each axis
  GravityUse windows;                                    ///< since the start
};

/// Corrections of roll and pitch by an accelerometer. Over windows of two seconds the mean specific
/// force, less the acceleration by the images' positions, is gravity, also while the camera moves.
/// A Kalman filter estimates from it the error of the pose's tilt, the direction of gravity in odom
/// and the bias of the accelerometer. Odom's axes are those of the first pose: where gravity points
/// in them is estimated, not assumed. Nothing is concluded about velocity or position.
/// Deterministic; not thread-safe.
class Gravity {
 public:
  /// \param T_camera_imu pose of the IMU in the rectified left camera.
  Gravity(const ImuParameters& parameters, const Eigen::Isometry3d& T_camera_imu);

  /// Takes the poses of a frame. \param gyroscope of the same IMU, which has its samples, too.
  void update(const FrameResult& result, const Gyroscope& gyroscope);

  /// The correction of the last frame's pose, once: nothing if there is no new one. It is taken as
  /// applied.
  std::optional<TiltCorrection> takeCorrection();

  /// Starts over, for an odometry that was reset: odom has other axes.
  void restart();

  /// Goes on in the same axes of odom after a gap, or with the IMU elsewhere on the camera.
  /// \param T_camera_imu as of the constructor.
  void continueAfterGap(const Eigen::Isometry3d& T_camera_imu);

  /// Takes other parameters; what was estimated is kept.
  void setParameters(const ImuParameters& parameters) { parameters_ = parameters; }

  GravityCalibration calibration() const;  ///< as estimated so far

 private:
  /// Errors of the pose's rotation and of `up_`, rotation vectors about the axes of odom, and of
  /// the bias.
  using Matrix9d = Eigen::Matrix<double, 9, 9>;

  /// A frame, and the specific force since the one before.
  struct Frame {
    std::int64_t stamp_ns = 0;
    Eigen::Isometry3d T_odom_camera = Eigen::Isometry3d::Identity();
    SpecificForce force;
    double step_variance = 0.0;  // of the motion since the one before, each axis [m^2]
    bool by_landmarks = false;   // it is not propagated to the next pose
  };

  /// Mean specific force of a window, in the axes of odom, less the acceleration by the images.
  struct Measurement {
    Eigen::Vector3d force = Eigen::Vector3d::Zero();  // [m/s^2]
    Eigen::Matrix3d J_bias;
    double variance = 0.0;  // of each axis
  };

  void addFrame(const FrameResult& result, const Gyroscope& gyroscope);
  std::optional<Measurement> measure() const;
  void update(const Measurement& measurement, const Matrix6d& pose_covariance);
  void start(const Measurement& measurement);
  void grow(const Eigen::Matrix3d& rotation_covariance);

  ImuParameters parameters_;
  Eigen::Isometry3d T_camera_imu_;
  std::vector<Frame> window_;
  bool known_ = false;
  Eigen::Vector3d up_ = Eigen::Vector3d::UnitZ();
  Eigen::Vector3d bias_ = Eigen::Vector3d::Zero();
  Matrix9d covariance_ = Matrix9d::Zero();
  Eigen::Matrix3d pose_covariance_ =
      Eigen::Matrix3d::Zero();  // of its rotation, at the last update
  std::int64_t updated_ns_ = 0;
  int rejected_in_a_row_ = 0;
  GravityUse windows_;
  std::optional<TiltCorrection> correction_;
};

}  // namespace point_line_odometry
