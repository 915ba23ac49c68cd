#include "odometry/frame_tracker.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "matching/appearance_matcher.h"
#include "motion/camera_motion.h"
#include "motion/motion_consensus.h"
#include "motion/observations.h"
#include "odometry/correspondences.h"
#include "odometry/motion_confirmation.h"
#include "odometry/motion_prediction.h"
#include "odometry/uncertainty.h"

namespace point_line_odometry {
namespace {

// If the map gives fewer matches than this share of those with the previous frame, these are used,
// too.
constexpr double kFewMapMatches = 0.5;

// Of the search radius, around points predicted by a rotation that far points agree on within a few
// pixels: clouds and a sky's noise give many wrong matches.
constexpr double kRadiusOfRotation = 0.3;

constexpr int kRelocalizationRounds = 2;

/// Appends the inlier matches of one kind; all of them if there is no motion.
template <typename Correspondence>
void appendMatches(const std::vector<Correspondence>& matches, const MotionEstimate& motion,
                   const std::vector<bool>& inliers, std::vector<Correspondence>* list) {
  for (std::size_t i = 0; i < matches.size(); ++i) {
    if (!motion.ok() || inliers[i]) list->push_back(matches[i]);
  }
}

/// The points with a depth, or those too far for one.
ReferencePoints referencePoints(const StereoFrame& frame, bool far) {
  ReferencePoints known;
  const std::vector<StereoDescriptor> descriptors = stereoDescriptors(frame);
  for (std::size_t i = 0; i < frame.points.size(); ++i) {
    if (frame.points[i].far != far) continue;
    known.descriptors.push_back(descriptors[i]);
    known.positions.push_back(frame.points[i].triangulated.p_camera);
  }
  return known;
}

ReferencePoints referencePoints(const LocalMap& map) {
  ReferencePoints known;
  const Eigen::Isometry3d T_previous_map = map.T_map_previous().inverse();
  for (const MapPoint& point : map.points()) {
    known.descriptors.push_back({point.left, point.right});
    known.positions.push_back(T_previous_map * point.estimate.value);
  }
  return known;
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

/// Keeps the matches from frame to frame, none of them as an inlier.
void dropMotion(TrackingResult* tracked) {
  MotionEstimate none;
  none.status = MotionStatus::kTooFewInliers;
  none.point_inliers.assign(tracked->correspondences.points.size(), false);
  none.line_inliers.assign(tracked->correspondences.lines.size(), false);
  tracked->motion = tracked->frame_to_frame = none;
  tracked->image_motion.reset();
  tracked->prior = {};
  tracked->landmark_matches.points.clear();
  tracked->landmark_matches.lines.clear();
  tracked->reason = TrackingReason::kTooFewInliers;
}

TrackingReason trackingReason(MotionStatus status) {
  switch (status) {
    case MotionStatus::kOk:
      return TrackingReason::kNone;
    case MotionStatus::kTooFewMatches:
      return TrackingReason::kTooFewMatches;
    case MotionStatus::kTooFewInliers:
      return TrackingReason::kTooFewInliers;
    case MotionStatus::kSolverFailed:
      break;
  }
  return TrackingReason::kSolverFailed;
}

}  // namespace

TrackingResult FrameTracker::track(const StereoFrame& curr) const {
  TrackingResult tracked = trackWith(curr, prior_.ofMotion());
  if (tracked.prior.use == PriorUse::kRejected) {
    const PriorReport rejected = tracked.prior;
    tracked = trackWith(curr, nullptr);
    if (tracked.image_motion) tracked.prior = rejected;  // not by a motion that was dropped
  } else if (prior_.use == PriorUse::kSuspended) {
    comparePrior(&tracked);
    tracked.prior.use = PriorUse::kSuspended;
  }
  return tracked;
}

/// Without a check of the prior's use.
TrackingResult FrameTracker::trackWith(const StereoFrame& curr, const MotionPrior* prior) const {
  const double dt_s = secondsBetween(*history_.previous, curr);
  const Expectation expected{predictMotion(velocity_, dt_s, parameters_, prior), prior};
  TrackingResult tracked = trackFrameToFrame(curr, expected);
  if (tracked.prior.use == PriorUse::kRejected) return tracked;
  if (history_.map) {
    const StageTimer timer(times_, Stage::kMap);
    trackLocalMap(curr, expected, &tracked);
    if (tracked.prior.use == PriorUse::kRejected) return tracked;
    if (tracked.motion.ok() && isRefuted(tracked, history_, context_.camera)) dropMotion(&tracked);
  }
  constrainWeakAxes(curr, &tracked);
  if (tracked.motion.ok()) {
    tracked.reason = reasonOf(tracked.motion, dt_s);
  } else {
    TrackingResult found = relocalize(curr);
    if (found.relocalized) return found;
  }
  return tracked;
}

/// Compares the prior with the motion by the images, if there is one.
void FrameTracker::comparePrior(TrackingResult* tracked) const {
  if (!prior_.since_previous || !tracked->image_motion) return;
  tracked->prior = PriorFactor::compare(*prior_.since_previous, tracked->image_motion->T_prev_curr,
                                        tracked->image_motion->covariance);
  const bool agrees = PriorFactor::agrees(tracked->prior);
  tracked->prior.use = agrees ? PriorUse::kUsed : PriorUse::kRejected;
}

TrackingResult FrameTracker::relocalize(const StereoFrame& curr) const {
  TrackingResult tracked;
  tracked.reason = TrackingReason::kTooFewInliers;
  const StageTimer timer(times_, Stage::kMap);
  if (!history_.map || curr.points.size() < kMinConsensus) return tracked;
  const LocalMap& map = *history_.map;
  const std::optional<MotionConsensus> consensus =
      findConsensus(matchWholeImage(referencePoints(map), curr, threads_), context_.camera);
  std::optional<Eigen::Isometry3d> T_curr_previous;
  if (consensus) T_curr_previous = consensus->T_curr_prev;
  // The consensus is accurate to a few pixels, so that the first round finds only some landmarks.
  for (int round = 0; round < kRelocalizationRounds && T_curr_previous; ++round) {
    tracked.landmark_matches =
        map.find(curr, context_, map.T_map_previous() * T_curr_previous->inverse(), threads_);
    tracked.motion = estimateMotion(map.correspondences(tracked.landmark_matches), context_.camera,
                                    *T_curr_previous, parameters_.motion, threads_);
    T_curr_previous =
        tracked.motion.ok() ? std::make_optional(tracked.motion.T_curr_prev) : std::nullopt;
  }
  if (T_curr_previous && isPlaceRecognized(map, tracked.landmark_matches, tracked.motion)) {
    const double dt_s = secondsBetween(*history_.previous, curr);
    tracked.reason = reasonOf(tracked.motion, dt_s);
  }
  tracked.relocalized = tracked.reason == TrackingReason::kNone;
  return tracked;
}

/// The estimate over two frames is independent of the frame-to-frame one: they run in parallel.
TrackingResult FrameTracker::trackFrameToFrame(const StereoFrame& curr,
                                               const Expectation& expected) const {
  TrackingResult tracked;
  const int few = parameters_.motion.min_matches;
  if (static_cast<int>(curr.points.size() + curr.lines.size()) < few) {
    tracked.reason = TrackingReason::kTooFewFeatures;
    return tracked;
  }
  const Stages frame_to_frame{Stage::kMatchCircular, Stage::kEstimate};
  MotionEstimate over_two_frames;
  // A prior gives the rotation better than the motion over two frames does.
  if (history_.before_previous && expected.prior == nullptr) {
    threads_->run(2, [&](int task) {
      if (task == 0) {
        tracked = matchAndEstimate(*history_.previous, curr, expected, frame_to_frame, nullptr);
      } else {
        const MotionPrediction& prediction = expected.prediction;
        const Expectation since_two_frames{
            {prediction.T_curr_prev * history_.before_previous->T_previous_before,
             prediction.radius_px},
            nullptr};
        over_two_frames = matchAndEstimate(history_.before_previous->frame, curr, since_two_frames,
                                           {Stage::kTwoFrames, Stage::kTwoFrames}, nullptr)
                              .frame_to_frame;
      }
    });
  } else {
    tracked = matchAndEstimate(*history_.previous, curr, expected, frame_to_frame, threads_);
  }
  tracked.motion = tracked.frame_to_frame;
  if (tracked.frame_to_frame.ok() && over_two_frames.ok()) {
    const StageTimer timer(times_, Stage::kFuse);
    tracked.motion = tracked.frame_to_frame =
        fuseRotation(tracked.frame_to_frame,
                     {over_two_frames.T_curr_prev, history_.before_previous->T_previous_before},
                     tracked.correspondences, context_.camera, parameters_.motion, threads_);
  }
  tracked.reason = trackingReason(tracked.frame_to_frame.status);
  return tracked;
}

/// Matches near the prediction, and where that finds few of the features in view, points with a
/// depth in the whole image. If that gives no motion: as far around the prediction as without a
/// velocity, then around a rotation by points too far for a depth.
TrackingResult FrameTracker::matchAndEstimate(const StereoFrame& earlier, const StereoFrame& curr,
                                              const Expectation& expected, const Stages& stages,
                                              ThreadPool* threads) const {
  const double radius_px = parameters_.matching.search_radius_px;
  TrackingResult tracked = matchAndEstimateNear(earlier, curr, expected, stages, threads);
  if (!parameters_.matching.wide_search) return tracked;
  if (shareFound(earlier, context_.camera, tracked) >= kShareFound) return tracked;
  if (const auto consensus = findConsensus(
          matchWholeImage(referencePoints(earlier, false), curr, threads), context_.camera)) {
    const Expectation by_appearance{{consensus->T_curr_prev, radius_px}, expected.prior};
    tracked = better(std::move(tracked),
                     matchAndEstimateNear(earlier, curr, by_appearance, stages, threads), earlier,
                     curr, expected, threads);
  }
  const double wide_px = parameters_.matching.search_radius_without_velocity_px;
  if (!tracked.frame_to_frame.ok() && expected.prediction.radius_px < wide_px) {
    const Expectation wider{{expected.prediction.T_curr_prev, wide_px}, expected.prior};
    TrackingResult retried = matchAndEstimateNear(earlier, curr, wider, stages, threads);
    const MotionEstimate& motion = retried.frame_to_frame;
    if (motion.num_point_inliers + motion.num_line_inliers >= kMinConsensus)
      tracked = better(std::move(tracked), std::move(retried), earlier, curr, expected, threads);
  }
  if (tracked.frame_to_frame.ok()) return tracked;
  const std::optional<MotionConsensus> turned =
      findRotation(matchWholeImage(referencePoints(earlier, true), curr, threads), context_.camera,
                   expected.prediction.T_curr_prev.inverse().translation());
  if (!turned) return tracked;
  const Expectation by_far{{turned->T_curr_prev, kRadiusOfRotation * radius_px}, expected.prior};
  TrackingResult retried = matchAndEstimateNear(earlier, curr, by_far, stages, threads);
  return retried.frame_to_frame.ok() ? retried : tracked;
}

/// Of two results of the same frame the one that finds more of the features. A motion that a camera
/// hardly makes is none by which few are found, nor against one that it does make and with which a
/// tenth of the features or the map agrees: something that moves by itself, as a car, may agree on
/// it, and may fill most of the view.
TrackingResult FrameTracker::better(TrackingResult tracked, TrackingResult retried,
                                    const StereoFrame& earlier, const StereoFrame& curr,
                                    const Expectation& expected, ThreadPool* threads) const {
  const double found = shareFound(earlier, context_.camera, tracked);
  const double found_retried = shareFound(earlier, context_.camera, retried);
  if (isImplausible(retried.frame_to_frame, expected, earlier, curr)) {
    const MotionEstimate& motion = tracked.frame_to_frame;
    const bool is_scene =
        !isImplausible(motion, expected, earlier, curr) &&
        (found >= kShareOfScene || isConfirmedByMap(motion, earlier, curr, threads));
    if (is_scene || found_retried < kShareFound) return tracked;
  }
  if (found_retried > found) return retried;
  return tracked;
}

/// Whether enough landmarks are found at a motion, compared with the frames before: few features
/// may agree with the right one, where something that moves otherwise fills most of the view.
bool FrameTracker::isConfirmedByMap(const MotionEstimate& motion, const StereoFrame& earlier,
                                    const StereoFrame& curr, ThreadPool* threads) const {
  if (!history_.map || &earlier != &*history_.previous || !motion.ok()) return false;
  const StageTimer timer(times_, Stage::kMap);
  const LocalMap& map = *history_.map;
  const LandmarkMatches matches =
      map.find(curr, context_, map.T_map_previous() * motion.T_curr_prev.inverse(), threads);
  const MotionEstimate against_map =
      estimateMotion(map.correspondences(matches), context_.camera, motion.T_curr_prev,
                     parameters_.motion, threads);
  return isConfirmed(map, matches, against_map);
}

/// The points that match by appearance.
std::vector<PointCorrespondence> FrameTracker::matchWholeImage(const ReferencePoints& known,
                                                               const StereoFrame& curr,
                                                               ThreadPool* threads) const {
  std::vector<PointCorrespondence> points;
  for (const IndexPair& match : matchByAppearance(known.descriptors, stereoDescriptors(curr),
                                                  parameters_.matching, threads)) {
    const StereoPoint& now = curr.points[match.second];
    points.push_back({pointObservation(curr.features.points_left[now.left].pixel, now.right_px, 1.0,
                                       context_.correction),
                      known.positions[match.first]});
  }
  return points;
}

TrackingResult FrameTracker::matchAndEstimateNear(const StereoFrame& earlier,
                                                  const StereoFrame& curr,
                                                  const Expectation& expected, const Stages& stages,
                                                  ThreadPool* threads) const {
  const MotionPrediction& prediction = expected.prediction;
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
      estimate(tracked.correspondences, expected, earlier, curr, threads, &tracked);
  if (!parameters_.matching.wide_search) return tracked;
  const std::vector<bool> resting = restingThatMayHold(earlier, curr, context_, tracked);
  if (resting.empty()) return tracked;
  TrackingResult freed;
  freed.matches = tracked.matches;
  freed.correspondences = tracked.correspondences;
  dropMatches(resting, &freed);
  freed.frame_to_frame = estimate(freed.correspondences, expected, earlier, curr, threads, &freed);
  if (isFreed(earlier, context_.camera, tracked, freed)) return freed;
  return tracked;
}

/// Projects the landmarks by the frame-to-frame motion, and estimates the motion against them.
void FrameTracker::trackLocalMap(const StereoFrame& curr, const Expectation& expected,
                                 TrackingResult* tracked) const {
  const Eigen::Isometry3d& T_curr_previous = tracked->frame_to_frame.ok()
                                                 ? tracked->frame_to_frame.T_curr_prev
                                                 : expected.prediction.T_curr_prev;
  tracked->landmark_matches = history_.map->find(
      curr, context_, history_.map->T_map_previous() * T_curr_previous.inverse(), threads_);
  Correspondences matches = history_.map->correspondences(tracked->landmark_matches);
  const Correspondences& frame_to_frame = tracked->correspondences;
  const auto size = [](const Correspondences& c) {
    return static_cast<double>(c.points.size() + c.lines.size());
  };
  if (size(matches) < kFewMapMatches * size(frame_to_frame)) {
    const MotionEstimate& motion = tracked->frame_to_frame;
    appendMatches(frame_to_frame.points, motion, motion.point_inliers, &matches.points);
    appendMatches(frame_to_frame.lines, motion, motion.line_inliers, &matches.lines);
  }
  const Expectation near{{T_curr_previous, expected.prediction.radius_px}, expected.prior};
  const MotionEstimate motion =
      estimate(matches, near, *history_.previous, curr, threads_, tracked);
  if (motion.ok()) {
    tracked->motion = motion;
  } else {
    tracked->landmark_matches.points.clear();
    tracked->landmark_matches.lines.clear();
  }
}

/// Only a prediction from a velocity distinguishes the camera's motion from that of moving objects.
MotionEstimate FrameTracker::estimateByImages(const Correspondences& matches,
                                              const Eigen::Isometry3d& T_curr_prev,
                                              const StereoFrame& prev, const StereoFrame& curr,
                                              ThreadPool* threads) const {
  if (!isCurrent(velocity_))
    return estimateMotion(matches, context_.camera, T_curr_prev, parameters_.motion, threads);
  return estimateCameraMotion(matches, context_.camera, atVelocity(T_curr_prev, prev, curr),
                              parameters_.motion, threads);
}

/// A prediction from the velocity, which must be current.
ConstantVelocityMotion FrameTracker::atVelocity(const Eigen::Isometry3d& T_curr_prev,
                                                const StereoFrame& prev,
                                                const StereoFrame& curr) const {
  const double dt_s = secondsBetween(prev, curr);
  return {T_curr_prev, dt_s * dt_s * velocity_->covariance, dt_s};
}

/// Whether a camera hardly moves so after the predicted motion; false without a current velocity.
bool FrameTracker::isImplausible(const MotionEstimate& motion, const Expectation& expected,
                                 const StereoFrame& prev, const StereoFrame& curr) const {
  if (!isCurrent(velocity_) || !parameters_.motion.solve_near_prediction) return false;
  return !isPlausible(motion, atVelocity(expected.prediction.T_curr_prev, prev, curr));
}

/// By the images alone, and again with the prior unless the two disagree.
MotionEstimate FrameTracker::estimate(const Correspondences& matches, const Expectation& expected,
                                      const StereoFrame& prev, const StereoFrame& curr,
                                      ThreadPool* threads, TrackingResult* tracked) const {
  const Eigen::Isometry3d& T_curr_prev = expected.prediction.T_curr_prev;
  MotionEstimate images = estimateByImages(matches, T_curr_prev, prev, curr, threads);
  if (images.ok()) {
    tracked->image_motion =
        ImageMotion{prev.stamp_ns, images.T_curr_prev.inverse(), images.covariance};
  }
  if (expected.prior == nullptr) return images;
  if (images.ok()) {
    comparePrior(tracked);
    if (tracked->prior.use == PriorUse::kRejected) return images;
  }
  std::optional<MotionEstimate> with_prior =
      estimateWithPrior(images, {PriorFactor(*expected.prior), T_curr_prev}, matches,
                        context_.camera, parameters_.motion, threads);
  if (!with_prior) return images;
  tracked->prior.use = PriorUse::kUsed;
  return *std::move(with_prior);
}

/// Fuses the motion with the prediction by their covariances (Kalman update) if some axis is better
/// constrained by the prediction; otherwise the prediction is not used. The prior is in the motion
/// already: it is not counted twice.
void FrameTracker::constrainWeakAxes(const StereoFrame& curr, TrackingResult* tracked) const {
  if (!parameters_.motion.predict_weak_axes || !tracked->motion.ok()) return;
  const double dt_s = secondsBetween(*history_.previous, curr);
  const double unmeasured_s = velocity_ ? toSeconds(curr.stamp_ns - velocity_->stamp_ns) : dt_s;
  const PredictedMotion expected =
      expectedMotion(velocity_, dt_s, unmeasured_s, parameters_.tracking);
  tracked->weak =
      constrainByPrediction(expected.T_prev_curr, expected.covariance, &tracked->motion);
}

TrackingReason FrameTracker::reasonOf(const MotionEstimate& motion, double dt_s) const {
  if (!motion.ok()) return trackingReason(motion.status);
  const Vector6d velocity = velocityOfMotion(motion.T_curr_prev.inverse(), dt_s);
  const bool too_fast =
      velocity.head<3>().norm() > parameters_.tracking.max_speed_m_s ||
      velocity.tail<3>().norm() * 180.0 / M_PI > parameters_.tracking.max_turn_rate_deg_s;
  return too_fast ? TrackingReason::kTooFast : TrackingReason::kNone;
}

}  // namespace point_line_odometry
