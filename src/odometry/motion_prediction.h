#pragma once

#include <optional>

#include "matching/expected_features.h"
#include "motion/frame_context.h"
#include "odometry/pose_integrator.h"
#include "odometry/uncertainty.h"
#include "point_line_odometry/motion_prior.h"
#include "point_line_odometry/parameters.h"

namespace point_line_odometry {

/// Covariance of a motion of which only the limits of the camera's speed are known.
Matrix6d covarianceByLimits(double dt_s, const TrackingParameters& limits);

bool isCurrent(const std::optional<CameraVelocity>& velocity);

/// For how long a current velocity, used for the motion since an earlier frame, has not been
/// measured [s]. \param dt_s since that frame.
double unmeasuredTime(const CameraVelocity& velocity, double dt_s, const FrameContext& context);

/// Motion over a time at the last velocity. Where it is not current, it is fused with the limits of
/// the camera's speed, which count the more the older it is; without one they are all that is
/// known. \param unmeasured_s since the velocity was measured, if it is not current.
PredictedMotion expectedMotion(const std::optional<CameraVelocity>& velocity, double dt_s,
                               double unmeasured_s, const TrackingParameters& limits);

/// Motion over a time at constant velocity, if it is current, else within the limits of the
/// camera's speed, fused with a prior (null: none). \param unmeasured_s since the velocity was
/// measured.
PredictedMotion predictStep(const std::optional<CameraVelocity>& velocity, double dt_s,
                            double unmeasured_s, const TrackingParameters& limits,
                            const MotionPrior* prior);

/// Covariance of the motion of a camera that may have stopped, or have gone on at the last
/// velocity, within the limits of its speed.
Matrix6d covarianceOfUnknownMotion(const std::optional<CameraVelocity>& velocity, double dt_s,
                                   double unmeasured_s, const TrackingParameters& limits);

/// Motion from an earlier frame to that of the context at constant velocity, if it is current,
/// fused with a prior (null: none), and the search radius; without either none.
MotionPrediction predictMotion(const std::optional<CameraVelocity>& velocity,
                               std::int64_t earlier_ns, const FrameContext& context,
                               const MotionPrior* prior);

}  // namespace point_line_odometry
