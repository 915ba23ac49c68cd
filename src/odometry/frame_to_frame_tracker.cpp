#include "odometry/frame_to_frame_tracker.h"

#include <algorithm>
#include <cstddef>
#include <optional>
#include <utility>
#include <vector>

#include "geometry/se3.h"
#include "matching/frame_matcher.h"
#include "motion/motion_consensus.h"
#include "motion/prior_factor.h"
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

// Motions by sequential RANSAC, and the least score of a different one, in times that of the best,
// where either may be right.
constexpr int kMaxHypotheses = 3;
constexpr double kScoreOfOther = 0.7;

/// By more than six of their standard deviations.
bool differ(const MotionEstimate& a, const MotionEstimate& b) {
  if (!a.ok() || !b.ok()) return false;
  constexpr double kSigmas = 6.0;
  const Vector6d difference = poseDifference(a.T_curr_prev.inverse(), b.T_curr_prev.inverse());
  return difference.dot((a.covariance + b.covariance).ldlt().solve(difference)) > kSigmas * kSigmas;
}

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
  const TrackingInput input{earlier, curr, stages, threads};
  TrackingResult tracked = trackNear(expected, input);
  if (!parameters_.matching.wide_search) return tracked;
  if (isFound(tracked, input) &&
      (estimator_.knowsVelocity() || PriorFactor::usesAllAxes(tracked.prior)))
    return tracked;
  tracked = trackByAppearance(std::move(tracked), expected, input);
  const double wide_px = parameters_.matching.search_radius_without_velocity_px;
  if (!tracked.frame_to_frame.ok() && expected.prediction.radius_px < wide_px) {
    TrackingResult retried =
        trackNear({{expected.prediction.T_curr_prev, wide_px}, expected.prior}, input);
    if (retried.frame_to_frame.numInliers() >= kMinConsensus &&
        isBetter(hypothesis(retried, input), hypothesis(tracked, input), expected, input))
      tracked = std::move(retried);
  }
  if (tracked.frame_to_frame.ok()) return tracked;
  const std::optional<MotionConsensus> turned =
      findRotation(matchWholeImage(referencePoints(earlier, true), curr, context_, threads),
                   context_.camera, expected.prediction.T_curr_prev.inverse().translation());
  if (!turned) return tracked;
  const double radius_px = kRadiusOfRotation * parameters_.matching.search_radius_px;
  TrackingResult retried = trackNear({{turned->T_curr_prev, radius_px}, expected.prior}, input);
  return retried.frame_to_frame.ok() ? retried : tracked;
}

/// Around motions by RANSAC of matches in the whole image. Where structure repeats itself, as the
/// stones of a road, the motion with the most inliers may be a wrong one (perceptual aliasing):
/// unless the velocity or a prior supports it, RANSAC is repeated on its outliers.
TrackingResult FrameToFrameTracker::trackByAppearance(TrackingResult tracked,
                                                      const ExpectedMotion& expected,
                                                      const TrackingInput& input) const {
  std::vector<PointCorrespondence> matches =
      matchWholeImage(referencePoints(input.earlier, false), input.curr, context_, input.threads);
  const auto leave_out = [&](const Eigen::Isometry3d& T_curr_prev) {
    matches = outliersOf(matches, context_.camera, T_curr_prev);
  };
  const auto track_at = [&](const Eigen::Isometry3d& T_curr_prev) {
    return trackNear({{T_curr_prev, parameters_.matching.search_radius_px}, expected.prior}, input);
  };
  const bool found = isFound(tracked, input);
  Hypothesis best = hypothesis(tracked, input);
  if (found) leave_out(best.motion.T_curr_prev);
  std::vector<Hypothesis> others;
  for (int i = 0; i < kMaxHypotheses; ++i) {
    const std::optional<MotionConsensus> consensus = findConsensus(matches, context_.camera);
    if (!consensus) break;
    // To be compared, what was found by a wide search has to be searched as narrowly.
    if (found && i == 0) {
      best.score = std::max(best.score, hypothesis(track_at(best.motion.T_curr_prev), input).score);
    }
    TrackingResult retried = track_at(consensus->T_curr_prev);
    Hypothesis other = hypothesis(retried, input);
    leave_out(consensus->T_curr_prev);
    if (other.motion.ok()) leave_out(other.motion.T_curr_prev);
    if (isBetter(other, best, expected, input)) {
      std::swap(other, best);
      tracked = std::move(retried);
    }
    if (isSupported(best, expected, input)) return tracked;
    others.push_back(std::move(other));
  }
  tracked.T_curr_prev_other = otherMotion(best, others);
  return tracked;
}

FrameToFrameTracker::Hypothesis FrameToFrameTracker::hypothesis(const TrackingResult& tracked,
                                                                const TrackingInput& input) const {
  const double share = shareFound(input.earlier, context_.camera, tracked);
  return {tracked.frame_to_frame, tracked.prior, share, share * shareAgreeing(tracked)};
}

/// The one with the highest score of those that may as well be right as the best.
std::optional<Eigen::Isometry3d> FrameToFrameTracker::otherMotion(
    const Hypothesis& best, const std::vector<Hypothesis>& others) {
  double least = kScoreOfOther * best.score;
  std::optional<Eigen::Isometry3d> T_curr_prev;
  for (const Hypothesis& other : others) {
    if (other.score < least || !differ(other.motion, best.motion)) continue;
    if (contradictsPrior(other, best)) continue;
    least = other.score;
    T_curr_prev = other.motion.T_curr_prev;
  }
  return T_curr_prev;
}

/// Whether a prior that agrees with the best motion rejects another.
bool FrameToFrameTracker::contradictsPrior(const Hypothesis& other, const Hypothesis& best) {
  return other.prior.use == PriorUse::kRejected && best.prior.use == PriorUse::kUsed;
}

bool FrameToFrameTracker::isFound(const TrackingResult& tracked, const TrackingInput& input) const {
  return shareFound(input.earlier, context_.camera, tracked) >= kShareFound;
}

/// By the velocity, or by a prior of all axes.
bool FrameToFrameTracker::isSupported(const Hypothesis& hypothesis, const ExpectedMotion& expected,
                                      const TrackingInput& input) const {
  if (PriorFactor::usesAllAxes(hypothesis.prior)) return true;
  return hypothesis.motion.ok() && estimator_.knowsVelocity() &&
         !estimator_.isImplausible(hypothesis.motion, expected, input.earlier);
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

/// Whether another motion of the same frame has a higher score than the best one, or if they hardly
/// differ, finds more features. A motion that a prior rejects is none against one with which it
/// agrees. A motion that a camera hardly makes is none by which few features are found, nor against
/// one that it does make and with which a tenth of the features or the map agrees: something that
/// moves by itself, as a car, may agree on it, and may fill most of the view.
bool FrameToFrameTracker::isBetter(const Hypothesis& other, const Hypothesis& best,
                                   const ExpectedMotion& expected,
                                   const TrackingInput& input) const {
  if (contradictsPrior(other, best)) return false;
  if (contradictsPrior(best, other)) return other.motion.ok();
  const auto is_implausible = [&](const Hypothesis& hypothesis) {
    return estimator_.isImplausible(hypothesis.motion, expected, input.earlier);
  };
  const auto is_scene = [&](const Hypothesis& plausible) {
    return plausible.share >= kShareOfScene || isConfirmedByMap(plausible.motion, input);
  };
  const bool best_is_implausible = is_implausible(best);
  if (is_implausible(other)) {
    if (other.share < kShareFound || (!best_is_implausible && is_scene(best))) return false;
  } else if (best_is_implausible && is_scene(other)) {
    return true;
  }
  if (differ(other.motion, best.motion)) return other.score > best.score;
  return other.share > best.share;
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
  return isConfirmed(map, matches, against_map, kShareMostlyHidden);
}

}  // namespace point_line_odometry
