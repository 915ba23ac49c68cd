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
  TrackingResult tracked = trackNear(earlier, curr, expected, stages, threads);
  if (!parameters_.matching.wide_search) return tracked;
  if (shareFound(earlier, context_.camera, tracked) >= kShareFound) return tracked;
  if (const auto consensus =
          findConsensus(matchWholeImage(referencePoints(earlier, false), curr, context_, threads),
                        context_.camera)) {
    const ExpectedMotion by_appearance{{consensus->T_curr_prev, radius_px}, expected.prior};
    tracked = better(std::move(tracked), trackNear(earlier, curr, by_appearance, stages, threads),
                     earlier, curr, expected, threads);
  }
  const double wide_px = parameters_.matching.search_radius_without_velocity_px;
  if (!tracked.frame_to_frame.ok() && expected.prediction.radius_px < wide_px) {
    const ExpectedMotion wider{{expected.prediction.T_curr_prev, wide_px}, expected.prior};
    TrackingResult retried = trackNear(earlier, curr, wider, stages, threads);
    const MotionEstimate& motion = retried.frame_to_frame;
    if (motion.num_point_inliers + motion.num_line_inliers >= kMinConsensus)
      tracked = better(std::move(tracked), std::move(retried), earlier, curr, expected, threads);
  }
  if (tracked.frame_to_frame.ok()) return tracked;
  const std::optional<MotionConsensus> turned =
      findRotation(matchWholeImage(referencePoints(earlier, true), curr, context_, threads),
                   context_.camera, expected.prediction.T_curr_prev.inverse().translation());
  if (!turned) return tracked;
  const ExpectedMotion by_far{{turned->T_curr_prev, kRadiusOfRotation * radius_px}, expected.prior};
  TrackingResult retried = trackNear(earlier, curr, by_far, stages, threads);
  return retried.frame_to_frame.ok() ? retried : tracked;
}

TrackingResult FrameToFrameTracker::trackNear(const StereoFrame& earlier, const StereoFrame& curr,
                                              const ExpectedMotion& expected,
                                              const TrackingStages& stages,
                                              ThreadPool* threads) const {
  MotionPrediction prediction = expected.prediction;
  prediction.shutter = context_.shutter;
  TrackingResult tracked;
  {
    const StageTimer timer(times_, stages.match);
    tracked.matches =
        matchCircular(earlier, curr, context_.camera, prediction, parameters_.matching, threads);
    tracked.correspondences = makeCorrespondences(earlier, curr, tracked.matches,
                                                  prediction.T_curr_prev, context_, threads);
  }
  const StageTimer timer(times_, stages.estimate);
  tracked.frame_to_frame =
      estimator_.estimate(tracked.correspondences, expected, earlier, threads, &tracked);
  if (!parameters_.matching.wide_search) return tracked;
  const std::vector<bool> resting = restingThatMayHold(earlier, curr, context_, tracked);
  if (resting.empty()) return tracked;
  TrackingResult freed;
  freed.matches = tracked.matches;
  freed.correspondences = tracked.correspondences;
  dropMatches(resting, &freed);
  freed.frame_to_frame =
      estimator_.estimate(freed.correspondences, expected, earlier, threads, &freed);
  if (isFreed(earlier, context_.camera, tracked, freed)) return freed;
  return tracked;
}

/// Of two results of the same frame the one that finds more of the features. A motion that a camera
/// hardly makes is none by which few are found, nor against one that it does make and with which a
/// tenth of the features or the map agrees: something that moves by itself, as a car, may agree on
/// it, and may fill most of the view.
TrackingResult FrameToFrameTracker::better(TrackingResult tracked, TrackingResult retried,
                                           const StereoFrame& earlier, const StereoFrame& curr,
                                           const ExpectedMotion& expected,
                                           ThreadPool* threads) const {
  const double found = shareFound(earlier, context_.camera, tracked);
  const double found_retried = shareFound(earlier, context_.camera, retried);
  if (estimator_.isImplausible(retried.frame_to_frame, expected, earlier)) {
    const MotionEstimate& motion = tracked.frame_to_frame;
    const bool is_scene =
        !estimator_.isImplausible(motion, expected, earlier) &&
        (found >= kShareOfScene || isConfirmedByMap(motion, earlier, curr, threads));
    if (is_scene || found_retried < kShareFound) return tracked;
  }
  if (found_retried > found) return retried;
  return tracked;
}

/// Whether enough landmarks are found at a motion, compared with the frames before: few features
/// may agree with the right one, where something that moves otherwise fills most of the view.
bool FrameToFrameTracker::isConfirmedByMap(const MotionEstimate& motion, const StereoFrame& earlier,
                                           const StereoFrame& curr, ThreadPool* threads) const {
  if (!history_.map || &earlier != &*history_.previous || !motion.ok()) return false;
  const StageTimer timer(times_, Stage::kMap);
  const LocalMap& map = *history_.map;
  const LandmarkMatches matches =
      map.find(curr, context_, map.T_map_previous() * motion.T_curr_prev.inverse(), threads);
  const MotionEstimate against_map =
      estimateMotion(map.correspondences(matches, context_), context_.camera, motion.T_curr_prev,
                     parameters_.motion, threads);
  return isConfirmed(map, matches, against_map);
}

}  // namespace point_line_odometry
