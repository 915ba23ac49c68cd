#include "motion/camera_motion.h"

#include <cmath>

#include "geometry/se3.h"

namespace point_line_odometry {
namespace {

// A camera's velocity hardly changes by more in a second. A motion beyond is checked against the
// prediction, not rejected.
constexpr double kMaxAcceleration = 5.0;          // [m/s^2]
constexpr double kMaxAngularAcceleration = 10.0;  // [rad/s^2]
constexpr double kNoiseSigmas = 3.0;              // of estimate and prediction, in addition

}  // namespace

bool isPlausible(const MotionEstimate& motion, const ConstantVelocityMotion& predicted) {
  if (!motion.ok()) return false;
  const Eigen::Isometry3d T_change = motion.T_curr_prev * predicted.T_curr_prev.inverse();
  const Vector6d variances = (motion.covariance + predicted.covariance).diagonal();
  const auto limit = [&](double max_acceleration, int first) {
    const double noise = std::sqrt(variances.segment<3>(first).sum());
    return max_acceleration * predicted.dt_s * predicted.dt_s + kNoiseSigmas * noise;
  };
  return T_change.translation().norm() <= limit(kMaxAcceleration, 0) &&
         rotationAngle(T_change.linear()) <= limit(kMaxAngularAcceleration, 3);
}

MotionEstimate estimateCameraMotion(const Correspondences& correspondences,
                                    const StereoCamera& camera,
                                    const ConstantVelocityMotion& predicted,
                                    const MotionParameters& parameters, ThreadPool* threads) {
  MotionEstimate of_majority =
      estimateMotion(correspondences, camera, predicted.T_curr_prev, parameters, threads);
  if (!parameters.solve_near_prediction || isPlausible(of_majority, predicted)) return of_majority;
  const MotionEstimate near_prediction = estimateMotionNearPrediction(
      correspondences, camera, predicted.T_curr_prev, parameters, threads);
  return isPlausible(near_prediction, predicted) ? near_prediction : of_majority;
}

}  // namespace point_line_odometry
