#pragma once

#include <Eigen/Geometry>
#include <optional>
#include <vector>

#include "common/thread_pool.h"
#include "matching/stereo_frame.h"
#include "motion/frame_context.h"
#include "odometry/frame_motion_estimator.h"
#include "odometry/stage_timer.h"
#include "odometry/tracking_result.h"
#include "point_line_odometry/parameters.h"

namespace point_line_odometry {

/// The stages to which the times of matching and of estimating are added.
struct TrackingStages {
  Stage match = Stage::kMatchCircular;
  Stage estimate = Stage::kEstimate;
};

/// Matches a frame with an earlier one and estimates the motion between them, by a search that
/// becomes wider where it finds too little.
class FrameToFrameTracker {
 public:
  /// All must outlive this. \param history of the frame; a motion may be confirmed by its map.
  FrameToFrameTracker(const FrameHistory& history, const FrameMotionEstimator& estimator,
                      const FrameContext& context, StageTimes* times)
      : history_(history),
        estimator_(estimator),
        context_(context),
        parameters_(context.parameters),
        times_(times) {}

  /// Matches near the prediction, and where that finds few of the features in view, or nothing
  /// supports the motion, points with a depth in the whole image. If that gives no motion: as far
  /// around the prediction as without a velocity, then around a rotation by points too far for a
  /// depth. The result has matches, correspondences and `frame_to_frame`, with the use of the
  /// prior.
  /// \param threads null: none.
  TrackingResult track(const StereoFrame& earlier, const StereoFrame& curr,
                       const ExpectedMotion& expected, const TrackingStages& stages,
                       ThreadPool* threads) const;

 private:
  /// Both frames, and what their tracking uses.
  struct TrackingInput {
    const StereoFrame& earlier;
    const StereoFrame& curr;
    const TrackingStages& stages;
    ThreadPool* threads;
  };

  /// A motion of the frame.
  struct Hypothesis {
    MotionEstimate motion;
    PriorReport prior;
    double share = 0.0;  ///< shareFound()
    double score = 0.0;  ///< times shareAgreeing(): at a wrong motion less of what is found agrees
  };

  TrackingResult trackByAppearance(TrackingResult tracked, const ExpectedMotion& expected,
                                   const TrackingInput& input) const;
  Hypothesis hypothesis(const TrackingResult& tracked, const TrackingInput& input) const;
  static std::optional<Eigen::Isometry3d> otherMotion(const Hypothesis& best,
                                                      const std::vector<Hypothesis>& others);
  static bool contradictsPrior(const Hypothesis& other, const Hypothesis& best);
  bool isFound(const TrackingResult& tracked, const TrackingInput& input) const;
  bool isSupported(const Hypothesis& hypothesis, const ExpectedMotion& expected,
                   const TrackingInput& input) const;
  TrackingResult trackNear(const ExpectedMotion& expected, const TrackingInput& input) const;
  CircularMatches match(const MotionPrediction& near, const TrackingInput& input) const;
  TrackingResult trackMatches(CircularMatches matches, const Eigen::Isometry3d& T_curr_prev,
                              const ExpectedMotion& expected, const TrackingInput& input) const;
  TrackingResult withoutRestingPoints(TrackingResult tracked, const ExpectedMotion& expected,
                                      const TrackingInput& input) const;
  bool isBetter(const Hypothesis& other, const Hypothesis& best, const ExpectedMotion& expected,
                const TrackingInput& input) const;
  bool isConfirmedByMap(const MotionEstimate& motion, const TrackingInput& input) const;

  const FrameHistory& history_;
  const FrameMotionEstimator& estimator_;
  const FrameContext& context_;
  const Parameters& parameters_;
  StageTimes* times_;
};

}  // namespace point_line_odometry
