#include "motion/camera_motion.h"

#include <cmath>

namespace point_line_odometry {
namespace {

// What a camera's velocity hardly changes by in a second. More is looked into, not refused.
constexpr double kMaxAcceleration = 5.0;          // [m/s^2]
constexpr double kMaxAngularAcceleration = 10.0;  // [rad/s^2]
constexpr double kNoiseSigmas = 3.0;              // of the estimate, on top of that

/// Whether a camera can have changed its motion from the predicted one to this.
bool plausible(const MotionEstimate& motion, const Eigen::Isometry3d& T_curr_prev_predicted,
               double dt_s) {
  if (!motion.ok()) return false;
  const Eigen::Isometry3d T_change = motion.T_curr_prev * T_curr_prev_predicted.inverse();
  const auto limit = [&](double max_acceleration, int first) {
    const double noise = std::sqrt(motion.covariance.diagonal().segment<3>(first).sum());
    return max_acceleration * dt_s * dt_s + kNoiseSigmas * noise;
  };
  return T_change.translation().norm() <= limit(kMaxAcceleration, 0) &&
         Eigen::AngleAxisd(T_change.linear()).angle() <= limit(kMaxAngularAcceleration, 3);
}

}  // namespace

MotionEstimate estimateCameraMotion(const Correspondences& correspondences,
                                    const StereoCamera& camera,
                                    const Eigen::Isometry3d& T_curr_prev_predicted, double dt_s,
                                    const MotionParameters& parameters) {
  MotionEstimate of_most =
      estimateMotion(correspondences, camera, T_curr_prev_predicted, parameters);
  if (!parameters.solve_near_prediction || plausible(of_most, T_curr_prev_predicted, dt_s))
    return of_most;
  const MotionEstimate of_world =
      estimateMotionNearPrediction(correspondences, camera, T_curr_prev_predicted, parameters);
  return plausible(of_world, T_curr_prev_predicted, dt_s) ? of_world : of_most;
}

}  // namespace point_line_odometry
