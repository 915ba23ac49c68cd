#include "odometry/odometry_pose.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

#include "geometry/se3.h"
#include "motion/prior_factor.h"
#include "odometry/motion_prediction.h"
#include "odometry/tilt.h"

namespace point_line_odometry {
namespace {

// How far a frame's step may differ from its estimated motion to follow the map, in standard
// deviations of the frame-to-frame motion: a larger correction is distributed over frames.
constexpr double kMaxCorrectionSigmas = 3.0;

// Errors of successive motions are correlated, as they come from the same features: this factor of
// a motion's covariance is propagated to the next poses, times the square root of the share of new
// features (1 from frame to frame, less against a map). Measured by Consistency in
// world_odometry_test: with 7 the normalised estimation error squared (NEES) of the pose is 3.7 in
// streets and 2.0 in rooms; 6 is its expectation, more would be overconfident.
constexpr double kErrorCorrelation = 7.0;

// Frames for which a velocity predicts pixels, however slow the camera is.
constexpr double kPredictedFrames = 3.0;

// Largest distance of a relocalized pose from the predicted one, in standard deviations.
constexpr double kMaxReachSigmas = 6.0;

}  // namespace

OdometryPose::OdometryPose(const Eigen::Isometry3d& T_odom_camera) : T_odom_map_(T_odom_camera) {
  integrator_.reset(T_odom_camera);
  smoother_.reset(T_odom_camera);
}

void OdometryPose::continueAt(const Eigen::Isometry3d& T_odom_camera) {
  integrator_.continueAt(T_odom_camera, smoother_.offsetCovariance());
  smoother_.reset(T_odom_camera);
  T_odom_map_ = T_odom_camera;
}

TrackingState OdometryPose::update(const TrackingResult& tracked, const FrameHistory& history,
                                   const FrameContext& context, double dt_s,
                                   const MotionPrior* prior) {
  const TrackingParameters& parameters = context.parameters.tracking;
  if (tracked.reason == TrackingReason::kFirstFrame && dt_s == 0.0) {
    smoother_.followUnknown(integrator_, Vector6d::Zero(), dt_s);
    return TrackingState::kInitializing;
  }
  if (tracked.reason != TrackingReason::kNone) return predict(dt_s, parameters, prior);
  const double since_previous_s = context.secondsSince(history.previous->stamp_ns);
  integrator_.addMeasurement(stepOf(tracked, history.map), since_previous_s, dt_s,
                             context.images.stamp_ns);
  const bool gap = dt_s > parameters.max_frame_gap_s;
  if (gap || since_previous_s > std::max(dt_s, parameters.max_prediction_s)) {
    integrator_.widenVelocity();
    smoother_.followUnknown(integrator_, integrator_.twist(), dt_s);
  } else if (tracked.ambiguous) {
    integrator_.loseVelocity();
    smoother_.followUnknown(integrator_, integrator_.twist(), dt_s);
  } else {
    smoother_.followMeasured(integrator_, dt_s, parameters.standstill_hold);
  }
  return tracked.weak || tracked.ambiguous ? TrackingState::kDegraded : TrackingState::kOk;
}

/// After a gap the pose is kept, however long a prediction may last, unless there is a prior of the
/// translation. What knows the rotation alone carries the pose without a gap: the speed hardly
/// changes from frame to frame.
TrackingState OdometryPose::predict(double dt_s, const TrackingParameters& parameters,
                                    const MotionPrior* prior) {
  const bool gap = dt_s > parameters.max_frame_gap_s;
  double max_s = gap ? 0.0 : parameters.max_prediction_s;
  if (prior != nullptr && (knowsTranslation(*prior) || (!gap && knowsRotation(*prior))))
    max_s = std::max(max_s, parameters.max_prior_prediction_s);
  if (!integrator_.addPrediction(dt_s, max_s, parameters, prior)) {
    smoother_.followUnknown(integrator_, Vector6d::Zero(), dt_s);
    return TrackingState::kLost;
  }
  smoother_.followPredicted(integrator_, dt_s);
  return TrackingState::kDegraded;
}

/// The step of T_odom_estimate, limited by the errors of a motion; see the class.
MotionStep OdometryPose::stepOf(const TrackingResult& tracked,
                                const std::optional<LocalMap>& map) const {
  MotionStep step;
  step.T_previous_camera = step.T_measured = tracked.motion.T_curr_prev.inverse();
  step.covariance = tracked.motion.covariance;
  step.error_correlation = kErrorCorrelation;
  step.is_propagated = !tracked.by_landmarks;
  if (!map) return step;
  Matrix6d limit =
      tracked.frame_to_frame.ok() ? tracked.frame_to_frame.covariance : step.covariance;
  limit.diagonal().head<3>().array() +=
      std::pow(PoseIntegrator::kScaleError, 2) * step.T_measured.translation().squaredNorm();
  const Eigen::Isometry3d T_odom_camera = T_odom_map_ * map->T_map_previous() * step.T_measured;
  step.T_previous_camera =
      limitedStep(step.T_measured, integrator_.T_odom_previous().inverse() * T_odom_camera, limit,
                  kMaxCorrectionSigmas);
  const double share_of_new = map->shareOfNew();
  step.error_correlation *= std::sqrt(share_of_new);
  // Landmarks created by the previous frame share its pose error, the others do not.
  step.previous_covariance = (1.0 - share_of_new) * map->previousCovariance();
  return step;
}

void OdometryPose::correctTilt(const TiltCorrection& correction) {
  const Eigen::Isometry3d T_correction =
      aboutPoint(correction, integrator_.T_odom_camera().translation());
  T_odom_map_ = T_correction * T_odom_map_;
  integrator_.correctTilt(T_correction, correction);
  smoother_.followCorrection(integrator_, T_correction);
}

std::optional<CameraVelocity> OdometryPose::velocityFor(
    std::int64_t stamp_ns, const TrackingParameters& parameters) const {
  std::optional<CameraVelocity> velocity = integrator_.velocity();
  if (!velocity) return velocity;
  const double unmeasured_s = toSeconds(stamp_ns - velocity->stamp_ns);
  const double predicted_s = integrator_.predictedTime();
  const bool gap = unmeasured_s - predicted_s > parameters.max_frame_gap_s;
  const double longest_s =
      std::max(parameters.max_prediction_s, kPredictedFrames * velocity->measured_over_s);
  if (gap || (predicted_s > 0.0 && unmeasured_s > longest_s)) velocity->is_current = false;
  return velocity;
}

MapAnchor OdometryPose::anchor() const {
  return {T_odom_map_, integrator_.T_odom_previous(), integrator_.previousCovariance()};
}

void OdometryPose::returnTo(const MapAnchor& anchor) {
  T_odom_map_ = anchor.T_odom_map;
  integrator_.returnTo(anchor.T_odom_previous, anchor.previous_covariance);
}

bool OdometryPose::isReachable(const Eigen::Isometry3d& T_odom_camera, double dt_s,
                               const TrackingParameters& parameters) const {
  PoseIntegrator expected = integrator_;
  expected.addPrediction(dt_s, parameters.max_prediction_s, parameters);
  const Vector6d difference = poseDifference(expected.T_odom_camera(), T_odom_camera);
  const double squared = difference.dot(expected.covariance().ldlt().solve(difference));
  return squared <= kMaxReachSigmas * kMaxReachSigmas;
}

void OdometryPose::report(TrackingState tracking, const TrackingParameters& parameters,
                          FrameResult* result) const {
  result->state = tracking;
  result->T_odom_camera = smoother_.T_odom_camera();
  result->T_odom_estimate = integrator_.T_odom_camera();
  result->estimate_covariance = integrator_.covariance();
  result->pose_covariance = smoother_.covariance(integrator_);
  result->twist = smoother_.holds() ? Vector6d::Zero() : integrator_.twist();
  // Before two frames were matched, zero is no measurement.
  const bool unknown = !velocity() && tracking != TrackingState::kDegraded;
  result->twist_covariance =
      unknown ? covarianceByLimits(1.0, parameters) : integrator_.twistCovariance();
  const bool measured = tracking == TrackingState::kOk && velocity() && velocity()->is_current;
  result->twist_over_s = measured ? velocity()->measured_over_s : 0.0;
}

}  // namespace point_line_odometry
