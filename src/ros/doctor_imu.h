#pragma once

/// \file
/// What the doctor finds out about an IMU from its rates and the rotations by the images.

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "point_line_odometry/frame_result.h"
#include "point_line_odometry/gyroscope.h"
#include "ros/doctor_report.h"

namespace point_line_odometry {

/// How well the rates of a gyroscope fit the rotations by the images.
struct RateFit {
  double rate_rad_s = 0.0;      ///< root mean square of the camera's rates
  double residual_rad_s = 0.0;  ///< of the given axes, without time offset beyond the allowed one
  /// The rotations by multiples of 90 degrees that fit far better than the given axes: axes of the
  /// IMU in its frame in tf. Several if the camera turns about one axis.
  std::vector<Eigen::Matrix3d> better;
  double best_residual_rad_s = 0.0;     ///< of the best rotation and time offset
  double time_offset_s = 0.0;           ///< best one, within +-kMaxOffset_s
  double residual_in_time_rad_s = 0.0;  ///< of the given axes with the best time offset

  static constexpr double kMaxOffset_s = 0.3;
};

/// Compares the mean rates between frames. \param motions by the images. \param to_ns stamps at
/// which they end. \return nothing if fewer than ten have samples.
std::optional<RateFit> fitRates(const std::vector<ImuSample>& samples,
                                const std::vector<ImageMotion>& motions,
                                const std::vector<std::int64_t>& to_ns,
                                const Eigen::Matrix3d& R_camera_imu,
                                const ImuParameters& parameters);

/// What is known of an IMU.
struct ImuCheckFacts {
  std::string topic;
  std::string frame;
  std::vector<ImuSample> samples;  ///< in the order of arrival
  /// Axes of the IMU in the left camera; nothing: tf does not know them.
  std::optional<Eigen::Matrix3d> R_camera_imu;
  std::optional<RateFit> fit;  ///< nothing: not measured
  ImuParameters parameters;
};

/// The line on the IMU.
DoctorLine checkImu(const ImuCheckFacts& facts);

}  // namespace point_line_odometry
