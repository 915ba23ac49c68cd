#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <functional>

#include "point_line_odometry/wheel_odometry.h"
#include "world/random.h"

namespace point_line_odometry::world {

/// Wheels that measure the speed along x and y of their body and its turn rate about z, as those of
/// an omnidirectional robot do; the pose is the sum of these on a plane.
struct WheelModel {
  double rate_hz = 50.0;
  double speed_noise = 0.02;   ///< standard deviation of a sample's speed [m/s]
  double turn_noise = 0.01;    ///< of its turn rate [rad/s]
  double scale_error = 0.0;    ///< share by which distance and turn are too large
  double slip = 0.0;           ///< share by which they are too large, too, while wheels slip
  double slip_period_s = 5.0;  ///< they slip once in it,
  double slip_s = 1.0;         ///< for so long
};

/// Samples of wheels in order of time. The same arguments give the same bits.
class WheelSampler {
 public:
  /// \param begin_s of the first sample. \param T_world_body pose of the wheels' body at a time.
  WheelSampler(const WheelModel& model, double begin_s,
               std::function<Eigen::Isometry3d(double)> T_world_body, std::uint32_t seed);

  OdometrySample next();

 private:
  bool slips(double time_s);

  WheelModel model_;
  double begin_s_;
  std::function<Eigen::Isometry3d(double)> T_world_body_;
  Random random_;
  Eigen::Isometry3d T_world_last_;
  Eigen::Vector3d pose_ = Eigen::Vector3d::Zero();  // x, y, yaw
  std::int64_t slip_period_ = -1;
  double slip_begin_s_ = 0.0;
  std::int64_t count_ = 0;
};

}  // namespace point_line_odometry::world
