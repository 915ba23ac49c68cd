#pragma once

#include <Eigen/Geometry>
#include <optional>

#include "common/thread_pool.h"
#include "matching/expected_features.h"
#include "matching/stereo_frame.h"
#include "motion/camera_motion.h"
#include "motion/correspondence.h"
#include "motion/frame_context.h"
#include "odometry/pose_integrator.h"
#include "odometry/prior_chain.h"
#include "odometry/tracking_result.h"

namespace point_line_odometry {

/// The motion that is expected, and the prior that is part of it (null: none).
struct ExpectedMotion {
  MotionPrediction prediction;
  const MotionPrior* prior = nullptr;
};

/// Estimates the motion of a frame from its correspondences with what is known of the camera: its
/// velocity, and the prior of this motion.
class FrameMotionEstimator {
 public:
  /// All must outlive this. \param velocity the last estimate, current or not; nothing if unknown.
  FrameMotionEstimator(const std::optional<CameraVelocity>& velocity, const FramePrior& prior,
                       const FrameContext& context)
      : velocity_(velocity), prior_(prior), context_(context) {}

  /// By the images alone, and again with the prior unless the two disagree. What the images gave
  /// alone and the use of the prior are put into the tracking result.
  /// \param earlier frame that the correspondences are with. \param threads null: none.
  MotionEstimate estimate(const Correspondences& matches, const ExpectedMotion& expected,
                          const StereoFrame& earlier, ThreadPool* threads,
                          TrackingResult* tracked) const;

  /// Whether a current velocity predicts the motion.
  bool knowsVelocity() const;

  /// Whether a camera hardly moves so after the predicted motion; false without a current velocity.
  bool isImplausible(const MotionEstimate& motion, const ExpectedMotion& expected,
                     const StereoFrame& earlier) const;

  /// Compares the prior with the motion by the images, if there is one.
  void comparePrior(TrackingResult* tracked) const;

 private:
  MotionEstimate estimateByImages(const Correspondences& matches,
                                  const Eigen::Isometry3d& T_curr_prev, const StereoFrame& earlier,
                                  ThreadPool* threads) const;
  ConstantVelocityMotion atVelocity(const Eigen::Isometry3d& T_curr_prev,
                                    const StereoFrame& earlier) const;

  const std::optional<CameraVelocity>& velocity_;
  const FramePrior& prior_;
  const FrameContext& context_;
};

}  // namespace point_line_odometry
