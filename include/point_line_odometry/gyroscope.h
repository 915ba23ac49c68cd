#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <deque>
#include <optional>

#include "point_line_odometry/frame_result.h"
#include "point_line_odometry/motion_prior.h"
#include "point_line_odometry/parameters.h"
#include "point_line_odometry/prior_trust.h"

namespace point_line_odometry {

/// One sample of an inertial measurement unit, in its own axes.
struct ImuSample {
  std::int64_t stamp_ns = 0;  ///< by the clock of the images, but for the time offset
  Eigen::Vector3d angular_velocity = Eigen::Vector3d::Zero();  ///< [rad/s]
  /// Specific force [m/s^2]: at rest 9.81 upwards.
  Eigen::Vector3d acceleration = Eigen::Vector3d::Zero();
};

/// Samples that were not used, since the start.
struct ImuFaults {
  std::size_t doubled = 0;               ///< with the stamp of another one
  std::size_t late = 0;                  ///< older than all that are kept
  std::size_t not_finite = 0;            ///< NaN or infinite rates
  std::size_t without_acceleration = 0;  ///< used, but NaN or infinite: not for gravity
  std::size_t saturated = 0;  ///< beyond imu/range_deg_s: the frames around them have no prior
};

/// What is estimated of a gyroscope, with standard deviations.
struct GyroscopeCalibration {
  Eigen::Vector3d bias = Eigen::Vector3d::Zero();        ///< in the axes of the IMU [rad/s]
  Eigen::Vector3d bias_sigma = Eigen::Vector3d::Zero();  ///< of each axis
  /// As Kalibr's timeshift_cam_imu: stamp of the IMU = stamp of the camera + offset.
  double time_offset_s = 0.0;
  double time_offset_sigma_s = 0.0;  ///< of it
};

/// Integrals of an accelerometer's specific force a, which is turned by the gyroscope into the axes
/// R of the left camera at their beginning.
struct SpecificForce {
  double duration_s = 0.0;                           ///< of the whole
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();     ///< of R a dt [m/s]
  Eigen::Vector3d moment = Eigen::Vector3d::Zero();  ///< of R a t dt [m]
  Eigen::Matrix3d rotation_sum =
      Eigen::Matrix3d::Zero();  ///< of R dt [s], from the axes of the IMU
  Eigen::Matrix3d rotation_moment = Eigen::Matrix3d::Zero();  ///< of R t dt [s^2]
  double squares = 0.0;                                       ///< of |a|^2 dt [m^2/s^3]
};

/// Motion priors of the camera's rotation between frames from the samples of a gyroscope, whose
/// bias and time offset are estimated by a Kalman filter from the rotations that the images give.
/// What a frame gets depends on the stamps of samples and frames, not on the order in which samples
/// arrive. Memory is bounded. Deterministic; not thread-safe.
class Gyroscope {
 public:
  /// \param R_camera_imu axes of the IMU in the rectified left camera.
  Gyroscope(const ImuParameters& parameters, const Eigen::Matrix3d& R_camera_imu);

  /// Takes a sample, in any order.
  void add(const ImuSample& sample);

  /// True if a sample is known that ends the interval until a frame: later ones do not change its
  /// prior.
  bool covers(std::int64_t frame_ns) const;

  /// The rotation between the stamps of two frames. Nothing if samples are missing or saturated, or
  /// it is not trusted.
  std::optional<MotionPrior> between(std::int64_t from_ns, std::int64_t to_ns) const;

  /// The specific force between the stamps of two frames; nothing likewise.
  std::optional<SpecificForce> forceBetween(std::int64_t from_ns, std::int64_t to_ns) const;

  /// Updates bias and time offset by the motion that the images of a frame gave.
  void update(const FrameResult& result);

  /// Discards the samples, for a clock that jumped; bias and time offset are kept.
  void clear();

  /// False while it is suspended, since too many of its rotations disagree with the images.
  bool isTrusted() const { return trust_.isTrusted(); }

  /// Another pose of the IMU on the camera; samples and what was estimated are kept.
  void setMounting(const Eigen::Matrix3d& R_camera_imu) { R_camera_imu_ = R_camera_imu; }

  /// Takes other parameters; what was estimated is kept unless they say otherwise.
  void setParameters(const ImuParameters& parameters);

  GyroscopeCalibration calibration() const;            ///< as estimated so far
  const ImuFaults& faults() const { return faults_; }  ///< of the samples

 private:
  /// Bias [rad/s] and time offset [s].
  using State = Eigen::Vector4d;

  /// The rotation from one instant to another, and what it depends on.
  struct Rotation {
    Eigen::Matrix3d R_from_to = Eigen::Matrix3d::Identity();  ///< axes of the IMU
    Eigen::Matrix<double, 3, 4> J_state;  ///< of a rotation in the axes of `from`, by the state
    Eigen::Matrix3d covariance;           ///< of that, without the state's
    SpecificForce force;                  ///< R from the IMU at an instant to that at `from`
  };

  void startFilter();
  void startTimeOffset();
  bool isSaturated(const ImuSample& sample) const;
  std::optional<MotionPrior> priorOf(const Rotation& rotation, std::int64_t from_ns,
                                     std::int64_t to_ns) const;
  std::optional<Rotation> integrate(std::int64_t from_ns, std::int64_t to_ns) const;
  void correct(const Rotation& rotation, const Eigen::Matrix3d& R_from_to_images,
               const Eigen::Matrix3d& covariance);
  void discardBefore(std::int64_t stamp_ns);

  ImuParameters parameters_;
  Eigen::Matrix3d R_camera_imu_;
  std::deque<ImuSample> samples_;  // by stamp
  State state_ = State::Zero();
  Eigen::Matrix4d covariance_ = Eigen::Matrix4d::Zero();
  std::optional<std::int64_t> updated_ns_;  // stamp of the last frame
  PriorTrust trust_;
  ImuFaults faults_;
};

}  // namespace point_line_odometry
