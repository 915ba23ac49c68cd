#include "odometry/motion_prediction.h"

#include <algorithm>
#include <cmath>

namespace point_line_odometry {
namespace {

constexpr double kMaxWidening = 4.0;  // of the search radius after missing motions

/// By a velocity measured before `unmeasured_s`, and a prior.
PredictedMotion motionByVelocity(const CameraVelocity& velocity, double dt_s, double unmeasured_s,
                                 const MotionPrior* prior) {
  const Matrix6d covariance = dt_s * dt_s * velocity.covariance +
                              predictionCovariance(velocity.value, true, dt_s, unmeasured_s);
  return predictedMotion(velocity.value, covariance, dt_s, prior);
}

PredictedMotion motionByLimits(double dt_s, const TrackingParameters& limits,
                               const MotionPrior* prior) {
  return predictedMotion(Vector6d::Zero(), covarianceByLimits(dt_s, limits), dt_s, prior);
}

}  // namespace

Matrix6d covarianceByLimits(double dt_s, const TrackingParameters& limits) {
  Matrix6d covariance = Matrix6d::Zero();
  covariance.diagonal().head<3>().setConstant(std::pow(limits.max_speed_m_s * dt_s, 2));
  covariance.diagonal().tail<3>().setConstant(
      std::pow(limits.max_turn_rate_deg_s * M_PI / 180.0 * dt_s, 2));
  return covariance;
}

bool isCurrent(const std::optional<CameraVelocity>& velocity) {
  return velocity && velocity->is_current;
}

double unmeasuredTime(const CameraVelocity& velocity, double dt_s, const FrameContext& context) {
  return velocity.since_previous ? context.secondsSince(velocity.stamp_ns) : dt_s;
}

PredictedMotion expectedMotion(const std::optional<CameraVelocity>& velocity, double dt_s,
                               double unmeasured_s, const TrackingParameters& limits) {
  if (!velocity) return motionByLimits(dt_s, limits, nullptr);
  if (velocity->is_current) return motionByVelocity(*velocity, dt_s, dt_s, nullptr);
  MotionPrior within_limits;
  within_limits.information.diagonal() = covarianceByLimits(dt_s, limits).diagonal().cwiseInverse();
  return motionByVelocity(*velocity, dt_s, unmeasured_s, &within_limits);
}

PredictedMotion predictStep(const std::optional<CameraVelocity>& velocity, double dt_s,
                            double unmeasured_s, const TrackingParameters& limits,
                            const MotionPrior* prior) {
  if (isCurrent(velocity)) return motionByVelocity(*velocity, dt_s, unmeasured_s, prior);
  return motionByLimits(dt_s, limits, prior);
}

Matrix6d covarianceOfUnknownMotion(const std::optional<CameraVelocity>& velocity, double dt_s,
                                   double unmeasured_s, const TrackingParameters& limits) {
  Matrix6d covariance = covarianceByLimits(dt_s, limits);
  if (!velocity) return covariance;
  const Matrix6d grown = dt_s * dt_s * velocity->covariance +
                         predictionCovariance(velocity->value, false, dt_s, unmeasured_s);
  covariance.diagonal() = covariance.diagonal().cwiseMin(grown.diagonal());
  return covariance;
}

MotionPrediction predictMotion(const std::optional<CameraVelocity>& velocity,
                               std::int64_t earlier_ns, const FrameContext& context,
                               const MotionPrior* prior) {
  const Parameters& parameters = context.parameters;
  const double dt_s = context.secondsSince(earlier_ns);
  const Eigen::Isometry3d T_curr_prev =
      predictStep(velocity, dt_s, dt_s, parameters.tracking, prior).T_prev_curr.inverse();
  if (!isCurrent(velocity))
    return {T_curr_prev, parameters.matching.search_radius_without_velocity_px};
  const double unmeasured_s = unmeasuredTime(*velocity, dt_s, context);
  const double widening = std::clamp(unmeasured_s / velocity->measured_over_s, 1.0, kMaxWidening);
  return {T_curr_prev, widening * parameters.matching.search_radius_px};
}

}  // namespace point_line_odometry
