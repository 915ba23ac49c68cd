#pragma once

#include <optional>

#include "common/thread_pool.h"
#include "matching/stereo_frame.h"
#include "motion/frame_context.h"
#include "odometry/frame_motion_estimator.h"
#include "odometry/frame_to_frame_tracker.h"
#include "odometry/pose_integrator.h"
#include "odometry/prior_chain.h"
#include "odometry/stage_timer.h"
#include "odometry/tracking_result.h"
#include "point_line_odometry/parameters.h"

namespace point_line_odometry {

/// Estimates the motion of one frame since the previous one: matches it with the previous frame,
/// with the frame before that if rotations are fused, and with the landmarks of the map.
class FrameTracker {
 public:
  /// All must outlive this. \param history with a previous frame. \param velocity the last
  /// estimate, for the prediction, current or not; nothing if unknown. \param prior of the motion.
  FrameTracker(const FrameHistory& history, const std::optional<CameraVelocity>& velocity,
               const FramePrior& prior, const FrameContext& context, ThreadPool* threads,
               StageTimes* times)
      : history_(history),
        velocity_(velocity),
        prior_(prior),
        context_(context),
        parameters_(context.parameters),
        threads_(threads),
        times_(times),
        estimator_(velocity, prior, context),
        frame_to_frame_(history, estimator_, context, times) {}

  // The one of frame to frame refers to the estimator.
  FrameTracker(const FrameTracker&) = delete;
  FrameTracker& operator=(const FrameTracker&) = delete;

  /// A prior that disagrees with the motion by the images alone is not used: then the frame is
  /// tracked again without it.
  TrackingResult track(const StereoFrame& curr) const;

  /// Tracks the frame by landmarks alone, without its features, which takes a small part of the
  /// time: the points of the previous frame are aligned coarsely where the velocity predicts them,
  /// and the landmarks that it observed where that motion does. Needs a map and a current velocity.
  /// Nothing where the motion is in any doubt: then the frame's features are to be detected.
  std::optional<TrackingResult> trackLandmarks() const;

  /// Relocalizes the camera in the map without a motion prediction: landmarks matched by appearance
  /// over the whole image, RANSAC consensus, then tracking against all landmarks. A wrong position
  /// is worse than none: it fails (reason kTooFewInliers, or kTooFast) unless most of the landmarks
  /// in view are found.
  TrackingResult relocalize(const StereoFrame& curr) const;

 private:
  TrackingResult trackWith(const StereoFrame& curr, const MotionPrior* prior) const;
  TrackingResult trackFrameToFrame(const StereoFrame& curr, const ExpectedMotion& expected) const;
  void trackLocalMap(const StereoFrame& curr, const ExpectedMotion& expected,
                     TrackingResult* tracked) const;
  std::optional<TrackingResult> trackLandmarksWith(const MotionPrior* prior) const;
  Eigen::Isometry3d coarseMotion(const ExpectedMotion& expected) const;
  void constrainWeakAxes(TrackingResult* tracked) const;
  TrackingReason reasonOf(const MotionEstimate& motion, double dt_s) const;

  const FrameHistory& history_;
  const std::optional<CameraVelocity>& velocity_;
  const FramePrior& prior_;
  const FrameContext& context_;
  const Parameters& parameters_;
  ThreadPool* threads_;
  StageTimes* times_;
  FrameMotionEstimator estimator_;
  FrameToFrameTracker frame_to_frame_;
};

}  // namespace point_line_odometry
