#include "odometry/frame_shutter.h"

#include <algorithm>
#include <cmath>

#include "odometry/motion_prediction.h"

namespace point_line_odometry {
namespace {

constexpr double kWeightOfError = 0.2;  // in the running means

RollingShutter shutterAt(const Vector6d& velocity, const Vector6d& variances, bool is_measured,
                         const Parameters& parameters) {
  return {1e-3 * parameters.tracking.rolling_shutter_ms, velocity, variances, is_measured};
}

/// Squared acceleration of a robot of which nothing is known, along and about an axis.
Eigen::Vector2d unknownAcceleration() {
  const Matrix6d of_velocity = predictionCovariance(Vector6d::Zero(), true, 1.0, 1.0);
  return {of_velocity(0, 0), of_velocity(3, 3)};
}

/// Variances of a velocity by a squared acceleration that is not known over half the time between
/// two frames.
Vector6d variancesBy(const Eigen::Vector2d& acceleration, double dt_s) {
  const Eigen::Vector2d of_velocity = std::pow(0.5 * dt_s, 2) * acceleration;
  Vector6d variances;
  variances << Eigen::Vector3d::Constant(of_velocity[0]), Eigen::Vector3d::Constant(of_velocity[1]);
  return variances;
}

}  // namespace

FrameShutter::FrameShutter() : acceleration_(unknownAcceleration()) {}

RollingShutter FrameShutter::predicted(const std::optional<CameraVelocity>& last,
                                       double unmeasured_s, const Parameters& parameters) const {
  if (isCurrent(last))
    return shutterAt(last->value, variancesBy(acceleration_, unmeasured_s), false, parameters);
  const Vector6d velocity = last ? last->value : Vector6d::Zero().eval();
  return shutterAt(velocity, predictionCovariance(velocity, false, 1.0, unmeasured_s).diagonal(),
                   false, parameters);
}

RollingShutter FrameShutter::measured(const Eigen::Isometry3d& T_curr_prev, double dt_s,
                                      const std::optional<CameraVelocity>& before,
                                      const Parameters& parameters) const {
  if (!(dt_s > 0.0)) return predicted(before, dt_s, parameters);
  Vector6d velocity = velocityOfMotion(T_curr_prev.inverse(), dt_s);
  Eigen::Vector2d acceleration = acceleration_;
  if (isCurrent(before)) {
    velocity += dt_s / (dt_s + before->measured_over_s) * (velocity - before->value);
  } else {
    acceleration = acceleration.cwiseMax(unknownAcceleration());
  }
  return shutterAt(velocity, variancesBy(acceleration, dt_s), true, parameters);
}

void FrameShutter::learn(const RollingShutter& shutter, const std::optional<CameraVelocity>& before,
                         const Eigen::Isometry3d& T_next_frame, double dt_s) {
  if (shutter.isGlobal() || !shutter.isMeasured() || !isCurrent(before) || !(dt_s > 0.0)) return;
  const Vector6d after = velocityOfMotion(T_next_frame.inverse(), dt_s);
  const double share = before->measured_over_s / (dt_s + before->measured_over_s);
  const Vector6d error = before->value + share * (after - before->value) - shutter.velocity();
  const double half_s = 0.25 * (before->measured_over_s + dt_s);
  Eigen::Vector2d squares(error.head<3>().squaredNorm() / 3.0, error.tail<3>().squaredNorm() / 3.0);
  squares /= half_s * half_s;
  if (squares.allFinite()) acceleration_ += kWeightOfError * (squares - acceleration_);
}

double rmsDifference(const RollingShutter& a, const RollingShutter& b, const StereoFrame& frame,
                     const StereoCamera& camera) {
  double squares = 0.0;
  int count = 0;
  const auto add = [&](const Eigen::Vector3d& p_camera) {
    if (!(p_camera.z() > camera.baseline_m)) return;
    squares += (camera.projectLeft(a.whenExposed(camera, p_camera)) -
                camera.projectLeft(b.whenExposed(camera, p_camera)))
                   .squaredNorm();
    ++count;
  };
  for (const StereoPoint& point : frame.points) add(point.triangulated.p_camera);
  for (const StereoLine& line : frame.lines) {
    if (!line.triangulated) continue;
    add(line.triangulated->start_camera);
    add(line.triangulated->end_camera);
  }
  return std::sqrt(squares / std::max(count, 1));
}

}  // namespace point_line_odometry
