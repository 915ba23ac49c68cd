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

bool isGlobal(const Parameters& parameters) {
  return parameters.tracking.rolling_shutter_ms == 0.0;
}

/// Variances of a velocity by an acceleration that was not known for a while, along and about an
/// axis.
Eigen::Vector2d unknownAcceleration(double unmeasured_s) {
  const Matrix6d covariance = predictionCovariance(Vector6d::Zero(), true, 1.0, unmeasured_s);
  return {covariance(0, 0), covariance(3, 3)};
}

/// The same along and about all axes.
Vector6d ofAllAxes(const Eigen::Vector2d& variances) {
  Vector6d all;
  all << Eigen::Vector3d::Constant(variances[0]), Eigen::Vector3d::Constant(variances[1]);
  return all;
}

}  // namespace

/// What is unknown of the acceleration acts over half the time between two frames.
Eigen::Vector2d FrameShutter::variances(double dt_s) const {
  const Eigen::Vector2d at_first = unknownAcceleration(0.5 * dt_s);
  return accelerations_ ? std::pow(0.5 * dt_s, 2) * *accelerations_ : at_first;
}

RollingShutter FrameShutter::predicted(const std::optional<CameraVelocity>& last,
                                       double unmeasured_s, const Parameters& parameters) const {
  if (isGlobal(parameters)) return {};
  if (isCurrent(last))
    return shutterAt(last->value, ofAllAxes(variances(unmeasured_s)), false, parameters);
  const Vector6d velocity = last ? last->value : Vector6d::Zero().eval();
  return shutterAt(velocity, predictionCovariance(velocity, false, 1.0, unmeasured_s).diagonal(),
                   false, parameters);
}

RollingShutter FrameShutter::measured(const Eigen::Isometry3d& T_curr_prev, double dt_s,
                                      const std::optional<CameraVelocity>& before,
                                      const Parameters& parameters) const {
  if (isGlobal(parameters)) return {};
  if (!(dt_s > 0.0)) return predicted(before, dt_s, parameters);
  Vector6d velocity = velocityOfMotion(T_curr_prev.inverse(), dt_s);
  Eigen::Vector2d of_velocity = variances(dt_s);
  if (isCurrent(before)) {
    velocity += dt_s / (dt_s + before->measured_over_s) * (velocity - before->value);
  } else {
    of_velocity = of_velocity.cwiseMax(unknownAcceleration(0.5 * dt_s));
  }
  return shutterAt(velocity, ofAllAxes(of_velocity), true, parameters);
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
  if (!squares.allFinite()) return;
  const Eigen::Vector2d so_far = accelerations_.value_or(unknownAcceleration(1.0));
  accelerations_ = so_far + kWeightOfError * (squares - so_far);
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
