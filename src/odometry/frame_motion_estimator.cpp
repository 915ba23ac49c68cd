#include "odometry/frame_motion_estimator.h"

#include <utility>

#include "motion/prior_factor.h"
#include "odometry/motion_prediction.h"

namespace point_line_odometry {

MotionEstimate FrameMotionEstimator::estimate(const Correspondences& matches,
                                              const ExpectedMotion& expected,
                                              const StereoFrame& earlier, ThreadPool* threads,
                                              TrackingResult* tracked) const {
  const Eigen::Isometry3d& T_curr_prev = expected.prediction.T_curr_prev;
  MotionEstimate images = estimateByImages(matches, T_curr_prev, earlier, threads);
  if (images.ok()) {
    tracked->image_motion =
        ImageMotion{earlier.stamp_ns, images.T_curr_prev.inverse(), images.covariance};
  }
  if (expected.prior == nullptr) return images;
  if (images.ok()) {
    comparePrior(tracked);
    if (tracked->prior.use == PriorUse::kRejected) return images;
  }
  std::optional<MotionEstimate> with_prior =
      estimateWithPrior(images, {PriorFactor(*expected.prior), T_curr_prev}, matches,
                        context_.camera, context_.parameters.motion, threads);
  if (!with_prior) return images;
  tracked->prior.use = PriorUse::kUsed;
  return *std::move(with_prior);
}

bool FrameMotionEstimator::knowsVelocity() const { return isCurrent(velocity_); }

bool FrameMotionEstimator::isImplausible(const MotionEstimate& motion,
                                         const ExpectedMotion& expected,
                                         const StereoFrame& earlier) const {
  if (!knowsVelocity() || !context_.parameters.motion.solve_near_prediction) return false;
  return !isPlausible(motion, atVelocity(expected.prediction.T_curr_prev, earlier));
}

void FrameMotionEstimator::comparePrior(TrackingResult* tracked) const {
  if (!prior_.since_previous || !tracked->image_motion) return;
  tracked->prior = PriorFactor::compare(*prior_.since_previous, tracked->image_motion->T_prev_curr,
                                        tracked->image_motion->covariance);
  const bool agrees = PriorFactor::agrees(tracked->prior);
  tracked->prior.use = agrees ? PriorUse::kUsed : PriorUse::kRejected;
}

/// Only a prediction from a velocity distinguishes the camera's motion from that of moving objects.
MotionEstimate FrameMotionEstimator::estimateByImages(const Correspondences& matches,
                                                      const Eigen::Isometry3d& T_curr_prev,
                                                      const StereoFrame& earlier,
                                                      ThreadPool* threads) const {
  if (!knowsVelocity())
    return estimateMotion(matches, context_.camera, T_curr_prev, context_.parameters.motion,
                          threads);
  return estimateCameraMotion(matches, context_.camera, atVelocity(T_curr_prev, earlier),
                              context_.parameters.motion, threads);
}

/// A prediction from the velocity, which must be current; the camera has accelerated since that.
ConstantVelocityMotion FrameMotionEstimator::atVelocity(const Eigen::Isometry3d& T_curr_prev,
                                                        const StereoFrame& earlier) const {
  const double dt_s = context_.secondsSince(earlier.stamp_ns);
  return {T_curr_prev, dt_s * dt_s * velocity_->covariance,
          unmeasuredTime(*velocity_, dt_s, context_)};
}

}  // namespace point_line_odometry
