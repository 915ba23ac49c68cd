#pragma once

#include <Eigen/Geometry>
#include <optional>
#include <tuple>
#include <vector>

#include "common/thread_pool.h"
#include "features/features.h"
#include "map/local_map.h"
#include "matching/expected_features.h"
#include "matching/frame_matcher.h"
#include "matching/stereo_frame.h"
#include "motion/camera_motion.h"
#include "motion/correspondence.h"
#include "motion/frame_context.h"
#include "motion/motion_estimator.h"
#include "odometry/pose_integrator.h"
#include "odometry/prior_chain.h"
#include "odometry/stage_timer.h"
#include "point_line_odometry/frame_result.h"
#include "point_line_odometry/parameters.h"

namespace point_line_odometry {

/// Frame k-2, for the fusion of rotations.
struct FrameBeforePrevious {
  StereoFrame frame;
  Eigen::Isometry3d T_previous_before = Eigen::Isometry3d::Identity();  ///< motion k-2 -> k-1

  auto state() {
    auto& [frame_of_this, T] = *this;
    return std::tie(frame_of_this, T);
  }
};

/// What earlier frames leave to track the next one against.
struct FrameHistory {
  std::optional<StereoFrame> previous;  ///< frame k-1: the last one that can be matched with
  std::optional<FrameBeforePrevious> before_previous;  ///< frame k-2, if rotations are fused
  std::optional<LocalMap> map;                         ///< nothing without a window

  auto state() {
    auto& [previous_of_this, before, map_of_this] = *this;
    return std::tie(previous_of_this, before, map_of_this);
  }
};

/// Result of tracking a frame: its motion since the previous frame.
struct TrackingResult {
  TrackingReason reason = TrackingReason::kNone;  ///< kNone: the motion was estimated
  CircularMatches matches;                        ///< (previous, current)
  Correspondences correspondences;                ///< of these
  MotionEstimate frame_to_frame;                  ///< from these only
  MotionEstimate motion;                          ///< the best one: against the map if there is one
  /// Of `motion`'s kind, by the images alone; nothing if they give none.
  std::optional<ImageMotion> image_motion;
  PriorReport prior;
  LandmarkMatches landmark_matches;
  /// The motion has weakly constrained axes, for which it was fused with the prediction.
  bool weak = false;
  /// The features found may rest on the robot's own body: the covariance covers the motion of a
  /// scene behind it, too.
  bool ambiguous = false;
  /// `motion` is from relocalization: landmarks matched by descriptors over the whole image.
  bool relocalized = false;
  bool in_lost_map = false;     ///< relocalized in the lost map: `motion` is since its last frame
  bool tried_lost_map = false;  ///< relocalization in the lost map failed
};

/// Known points to match by appearance: element i of both lists is one point.
struct ReferencePoints {
  std::vector<Eigen::Vector3d> positions;  ///< in the earlier camera [m]
  std::vector<StereoDescriptor> descriptors;
};

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
        times_(times) {}

  /// A prior that disagrees with the motion by the images alone is not used: then the frame is
  /// tracked again without it.
  TrackingResult track(const StereoFrame& curr) const;

  /// Relocalizes the camera in the map without a motion prediction: landmarks matched by appearance
  /// over the whole image, RANSAC consensus, then tracking against all landmarks. A wrong position
  /// is worse than none: it fails (reason kTooFewInliers, or kTooFast) unless most of the landmarks
  /// in view are found.
  TrackingResult relocalize(const StereoFrame& curr) const;

 private:
  /// The stages to which times are added.
  struct Stages {
    Stage match;
    Stage estimate;
  };

  /// The motion that is expected, and the prior that is part of it.
  struct Expectation {
    MotionPrediction prediction;
    const MotionPrior* prior;
  };

  TrackingResult trackWith(const StereoFrame& curr, const MotionPrior* prior) const;
  TrackingResult trackFrameToFrame(const StereoFrame& curr, const Expectation& expected) const;
  TrackingResult matchAndEstimate(const StereoFrame& earlier, const StereoFrame& curr,
                                  const Expectation& expected, const Stages& stages,
                                  ThreadPool* threads) const;
  TrackingResult better(TrackingResult tracked, TrackingResult retried, const StereoFrame& earlier,
                        const StereoFrame& curr, const Expectation& expected,
                        ThreadPool* threads) const;
  bool isConfirmedByMap(const MotionEstimate& motion, const StereoFrame& earlier,
                        const StereoFrame& curr, ThreadPool* threads) const;
  TrackingResult matchAndEstimateNear(const StereoFrame& earlier, const StereoFrame& curr,
                                      const Expectation& expected, const Stages& stages,
                                      ThreadPool* threads) const;
  std::vector<PointCorrespondence> matchWholeImage(const ReferencePoints& known,
                                                   const StereoFrame& curr,
                                                   ThreadPool* threads) const;
  void trackLocalMap(const StereoFrame& curr, const Expectation& expected,
                     TrackingResult* tracked) const;
  bool isImplausible(const MotionEstimate& motion, const Expectation& expected,
                     const StereoFrame& prev, const StereoFrame& curr) const;
  MotionEstimate estimateByImages(const Correspondences& matches,
                                  const Eigen::Isometry3d& T_curr_prev, const StereoFrame& prev,
                                  const StereoFrame& curr, ThreadPool* threads) const;
  ConstantVelocityMotion atVelocity(const Eigen::Isometry3d& T_curr_prev, const StereoFrame& prev,
                                    const StereoFrame& curr) const;
  MotionEstimate estimate(const Correspondences& matches, const Expectation& expected,
                          const StereoFrame& prev, const StereoFrame& curr, ThreadPool* threads,
                          TrackingResult* tracked) const;
  void comparePrior(TrackingResult* tracked) const;
  void constrainWeakAxes(const StereoFrame& curr, TrackingResult* tracked) const;
  TrackingReason reasonOf(const MotionEstimate& motion, double dt_s) const;

  const FrameHistory& history_;
  const std::optional<CameraVelocity>& velocity_;
  const FramePrior& prior_;
  const FrameContext& context_;
  const Parameters& parameters_;
  ThreadPool* threads_;
  StageTimes* times_;
};

}  // namespace point_line_odometry
