#include "odometry/frame_to_frame_tracker.h"

#include <cstddef>
#include <optional>
#include <utility>
#include <vector>

#include "matching/frame_matcher.h"
#include "motion/motion_consensus.h"
#include "odometry/correspondences.h"
#include "odometry/motion_confirmation.h"
#include "odometry/whole_image_search.h"

namespace point_line_odometry {
namespace {

// Of the search radius, around points predicted by a rotation that far points agree on within a few
// pixels: clouds and a sky's noise give many wrong matches.
constexpr double kRadiusOfRotation = 0.3;

// Patches that are aligned again by a motion agree with it, unless it was wrong: then inliers get
// lost.
constexpr double kShareAgain = 0.8;

/// Removes some of the matches of points.
void dropMatches(const std::vector<bool>& dropped, TrackingResult* tracked) {
  std::vector<PointCorrespondence>& points = tracked->correspondences.points;
  std::vector<IndexPair>& matches = tracked->matches.points;
  std::size_t kept = 0;
  for (std::size_t i = 0; i < dropped.size(); ++i) {
    if (dropped[i]) continue;
    points[kept] = points[i];
    matches[kept++] = matches[i];
  }
  points.resize(kept);
  matches.resize(kept);
}

}  // namespace

TrackingResult FrameToFrameTracker::track(const StereoFrame& earlier, const StereoFrame& curr,
                                          const ExpectedMotion& expected,
                                          const TrackingStages& stages, ThreadPool* threads) const {
  const double radius_px = parameters_.matching.search_radius_px;
  const TrackingInput input{earlier, curr, stages, threads};
  TrackingResult tracked = trackNear(expected, input);
  if (!parameters_.matching.wide_search) return tracked;
  if (shareFound(earlier, context_.camera, tracked) >= kShareFound) return tracked;
  if (const auto consensus =
          findConsensus(matchWholeImage(referencePoints(earlier, false), curr, context_, threads),
                        context_.camera)) {
    const ExpectedMotion by_appearance{{consensus->T_curr_prev, radius_px}, expected.prior};
    tracked = better(std::move(tracked), trackNear(by_appearance, input), expected, input);
  }
  const double wide_px = parameters_.matching.search_radius_without_velocity_px;
  if (!tracked.frame_to_frame.ok() && expected.prediction.radius_px < wide_px) {
    const ExpectedMotion wider{{expected.prediction.T_curr_prev, wide_px}, expected.prior};
    TrackingResult retried = trackNear(wider, input);
    if (retried.frame_to_frame.numInliers() >= kMinConsensus)
      tracked = better(std::move(tracked), std::move(retried), expected, input);
  }
  if (tracked.frame_to_frame.ok()) return tracked;
  const std::optional<MotionConsensus> turned =
      findRotation(matchWholeImage(referencePoints(earlier, true), curr, context_, threads),
                   context_.camera, expected.prediction.T_curr_prev.inverse().translation());
  if (!turned) return tracked;
  const ExpectedMotion by_far{{turned->T_curr_prev, kRadiusOfRotation * radius_px}, expected.prior};
  TrackingResult retried = trackNear(by_far, input);
  return retried.frame_to_frame.ok() ? retried : tracked;
}

/// Without a velocity the prediction may be far off, and the alignment of patches is biased towards
/// their warps: where the motion that is found warps them otherwise, they are aligned again by it.
/// With a velocity this is left to the alignment of landmarks, which are warped by what is found.
TrackingResult FrameToFrameTracker::trackNear(const ExpectedMotion& expected,
                                              const TrackingInput& input) const {
  const Eigen::Isometry3d& T_predicted = expected.prediction.T_curr_prev;
  TrackingResult tracked =
      trackMatches(match(expected.prediction, input), T_predicted, expected, input);
  const MotionEstimate& first = tracked.frame_to_frame;
  if (first.ok() && !estimator_.knowsVelocity() && parameters_.matching.refine_subpixel &&
      warpsDiffer(input.earlier, tracked.matches, first, T_predicted, context_.camera)) {
    TrackingResult again = trackMatches(tracked.matches, first.T_curr_prev, expected, input);
    // Not by the prior alone, which the first motion of the images may have contradicted.
    if (again.image_motion && again.frame_to_frame.ok() &&
        again.frame_to_frame.numInliers() >= kShareAgain * first.numInliers())
      tracked = std::move(again);
  }
  return withoutRestingPoints(std::move(tracked), expected, input);
}

CircularMatches FrameToFrameTracker::match(const MotionPrediction& near,
                                           const TrackingInput& input) const {
  const StageTimer timer(times_, input.stages.match);
  MotionPrediction prediction = near;
  prediction.shutter = context_.shutter;
  return matchCircular(input.earlier, input.curr, context_.camera, prediction, parameters_.matching,
                       input.threads);
}

/// \param T_curr_prev by which patches are warped.
TrackingResult FrameToFrameTracker::trackMatches(CircularMatches matches,
                                                 const Eigen::Isometry3d& T_curr_prev,
                                                 const ExpectedMotion& expected,
                                                 const TrackingInput& input) const {
  TrackingResult tracked;
  tracked.matches = std::move(matches);
  {
    const StageTimer timer(times_, input.stages.match);
    tracked.correspondences = makeCorrespondences(input.earlier, input.curr, tracked.matches,
                                                  T_curr_prev, context_, input.threads);
  }
  const StageTimer timer(times_, input.stages.estimate);
  tracked.frame_to_frame = estimator_.estimate(tracked.correspondences, expected, input.earlier,
                                               input.threads, &tracked);
  return tracked;
}

/// Without resting far points, if they held the motion.
TrackingResult FrameToFrameTracker::withoutRestingPoints(TrackingResult tracked,
                                                         const ExpectedMotion& expected,
                                                         const TrackingInput& input) const {
  if (!parameters_.matching.wide_search) return tracked;
  const StageTimer timer(times_, input.stages.estimate);
  const std::vector<bool> resting =
      restingThatMayHold(input.earlier, input.curr, context_, tracked);
  if (resting.empty()) return tracked;
  TrackingResult without;
  without.matches = tracked.matches;
  without.correspondences = tracked.correspondences;
  dropMatches(resting, &without);
  without.frame_to_frame = estimator_.estimate(without.correspondences, expected, input.earlier,
                                               input.threads, &without);
  return isFreed(input.earlier, context_.camera, tracked, without) ? without : tracked;
}

/// Of two results of the same frame the one that finds more of the features. A motion that a camera
/// hardly makes is none by which few are found, nor against one that it does make and with which a
/// tenth of the features or the map agrees: something that moves by itself, as a car, may agree on
/// it, and may fill most of the view.
TrackingResult FrameToFrameTracker::better(TrackingResult tracked, TrackingResult retried,
                                           const ExpectedMotion& expected,
                                           const TrackingInput& input) const {
  const double found = shareFound(input.earlier, context_.camera, tracked);
  const double found_retried = shareFound(input.earlier, context_.camera, retried);
  if (estimator_.isImplausible(retried.frame_to_frame, expected, input.earlier)) {
    const MotionEstimate& motion = tracked.frame_to_frame;
    const bool is_scene = !estimator_.isImplausible(motion, expected, input.earlier) &&
                          (found >= kShareOfScene || isConfirmedByMap(motion, input));
    if (is_scene || found_retried < kShareFound) return tracked;
  }
  if (found_retried > found) return retried;
  return tracked;
}

/// Whether enough landmarks are found at a motion, compared with the frames before: few features
/// may agree with the right one, where something that moves otherwise fills most of the view.
bool FrameToFrameTracker::isConfirmedByMap(const MotionEstimate& motion,
                                           const TrackingInput& input) const {
  if (!history_.map || &input.earlier != &*history_.previous || !motion.ok()) return false;
  const StageTimer timer(times_, Stage::kMap);
  const LocalMap& map = *history_.map;
  const LandmarkMatches matches = map.find(
      input.curr, context_, map.T_map_previous() * motion.T_curr_prev.inverse(), input.threads);
  const MotionEstimate against_map =
      estimateMotion(map.correspondences(matches, context_), context_.camera, motion.T_curr_prev,
                     parameters_.motion, input.threads);
  return isConfirmed(map, matches, against_map);
}

}  // namespace point_line_odometry
