#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <functional>

#include "point_line_odometry/gyroscope.h"
#include "world/random.h"

namespace point_line_odometry::world {

/// The inertial measurement unit of EuRoC's micro air vehicle (ADIS16448, 200 Hz).
struct ImuModel {
  double rate_hz = 200.0;
  double gyroscope_noise = 1.6968e-4;         ///< [rad/s/sqrt(Hz)]
  double gyroscope_random_walk = 1.9393e-5;   ///< [rad/s^2/sqrt(Hz)]
  double accelerometer_noise = 2.0e-3;        ///< [m/s^2/sqrt(Hz)]
  double accelerometer_random_walk = 3.0e-3;  ///< [m/s^3/sqrt(Hz)]
  double first_gyroscope_bias = 0.03;         ///< largest in an axis [rad/s]
  double first_accelerometer_bias = 0.1;      ///< largest in an axis [m/s^2]
  double time_offset_s = 0.0;                 ///< of its stamps
};

/// Samples of an IMU in order of time. The same arguments give the same bits.
class ImuSampler {
 public:
  /// \param begin_s of the first sample. \param T_world_imu its pose at a time; the world's z is
  /// up.
  ImuSampler(const ImuModel& model, double begin_s,
             std::function<Eigen::Isometry3d(double)> T_world_imu, std::uint32_t seed);

  ImuSample next();

 private:
  ImuModel model_;
  double begin_s_;
  std::function<Eigen::Isometry3d(double)> T_world_imu_;
  Random random_;
  Eigen::Vector3d gyroscope_bias_;
  Eigen::Vector3d accelerometer_bias_;
  std::int64_t count_ = 0;
};

}  // namespace point_line_odometry::world
