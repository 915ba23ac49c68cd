#include "odometry/frame_tracker.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "motion/motion_consensus.h"
#include "odometry/correspondences.h"
#include "odometry/motion_confirmation.h"
#include "odometry/motion_prediction.h"
#include "odometry/uncertainty.h"
#include "odometry/whole_image_search.h"

namespace point_line_odometry {
namespace {

// If the map gives fewer matches than this share of those with the previous frame, these are used,
// too.
constexpr double kFewMapMatches = 0.5;

constexpr int kRelocalizationRounds = 2;

/// Appends the inlier matches of one kind; all of them if there is no motion.
template <typename Correspondence>
void appendMatches(const std::vector<Correspondence>& matches, const MotionEstimate& motion,
                   const std::vector<bool>& inliers, std::vector<Correspondence>* list) {
  for (std::size_t i = 0; i < matches.size(); ++i) {
    if (!motion.ok() || inliers[i]) list->push_back(matches[i]);
  }
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
    estimator_.comparePrior(&tracked);
    tracked.prior.use = PriorUse::kSuspended;
  }
  return tracked;
}

/// Without a check of the prior's use.
TrackingResult FrameTracker::trackWith(const StereoFrame& curr, const MotionPrior* prior) const {
  const double dt_s = context_.secondsSince(history_.previous->stamp_ns);
  const ExpectedMotion expected{
      predictMotion(velocity_, history_.previous->stamp_ns, context_, prior), prior};
  TrackingResult tracked = trackFrameToFrame(curr, expected);
  if (tracked.prior.use == PriorUse::kRejected) return tracked;
  if (history_.map) {
    const StageTimer timer(times_, Stage::kMap);
    trackLocalMap(curr, expected, &tracked);
    if (tracked.prior.use == PriorUse::kRejected) return tracked;
    if (tracked.motion.ok() && isRefuted(tracked, history_, context_.camera)) dropMotion(&tracked);
  }
  constrainWeakAxes(&tracked);
  if (tracked.motion.ok()) {
    tracked.reason = reasonOf(tracked.motion, dt_s);
  } else {
    TrackingResult found = relocalize(curr);
    if (found.relocalized) return found;
  }
  return tracked;
}

std::optional<TrackingResult> FrameTracker::trackLandmarks() const {
  const StageTimer timer(times_, Stage::kMap);
  const MotionPrior* prior = prior_.ofMotion();
  std::optional<TrackingResult> tracked = trackLandmarksWith(prior);
  if (prior != nullptr && (!tracked || tracked->prior.use == PriorUse::kRejected)) {
    tracked = trackLandmarksWith(nullptr);
    if (!tracked) return std::nullopt;
    estimator_.comparePrior(&*tracked);
    if (tracked->prior.use != PriorUse::kRejected) return std::nullopt;
  } else if (tracked && prior_.use == PriorUse::kSuspended) {
    estimator_.comparePrior(&*tracked);
    tracked->prior.use = PriorUse::kSuspended;
  }
  return tracked;
}

/// Without a check of the prior's use.
std::optional<TrackingResult> FrameTracker::trackLandmarksWith(const MotionPrior* prior) const {
  const LocalMap& map = *history_.map;
  const ExpectedMotion expected{
      predictMotion(velocity_, history_.previous->stamp_ns, context_, prior), prior};
  const ExpectedMotion near{{coarseMotion(expected), expected.prediction.radius_px}, prior};
  const Eigen::Isometry3d& T_curr_previous = near.prediction.T_curr_prev;
  TrackingResult tracked;
  tracked.by_landmarks = true;
  tracked.landmark_matches =
      map.align(context_, map.T_map_previous() * T_curr_previous.inverse(), threads_);
  tracked.correspondences = map.correspondences(tracked.landmark_matches, context_);
  tracked.motion =
      estimator_.estimate(tracked.correspondences, near, *history_.previous, threads_, &tracked);
  if (tracked.prior.use == PriorUse::kRejected) return tracked;
  if (!isFoundAgain(tracked) ||
      estimator_.isImplausible(tracked.motion, expected, *history_.previous))
    return std::nullopt;
  constrainWeakAxes(&tracked);
  tracked.reason = reasonOf(tracked.motion, context_.secondsSince(history_.previous->stamp_ns));
  if (tracked.weak || tracked.reason != TrackingReason::kNone) return std::nullopt;
  return tracked;
}

/// By points of the previous frame in the coarsest octave, to bring patches of the images
/// themselves near enough to be aligned; as expected if these show none.
Eigen::Isometry3d FrameTracker::coarseMotion(const ExpectedMotion& expected) const {
  const Eigen::Isometry3d& T_curr_previous = expected.prediction.T_curr_prev;
  ImagePyramid previous_image = history_.previous->left_image;
  if (previous_image.levels.size() == 1) previous_image.addLevels(parameters_.points);
  const Correspondences points =
      alignCoarsely(*history_.previous, previous_image, T_curr_previous, context_, threads_);
  TrackingResult unused;
  const MotionEstimate motion =
      estimator_.estimate(points, expected, *history_.previous, threads_, &unused);
  return motion.ok() ? motion.T_curr_prev : T_curr_previous;
}

TrackingResult FrameTracker::relocalize(const StereoFrame& curr) const {
  TrackingResult tracked;
  tracked.reason = TrackingReason::kTooFewInliers;
  const StageTimer timer(times_, Stage::kMap);
  if (!history_.map || curr.points.size() < kMinConsensus) return tracked;
  const LocalMap& map = *history_.map;
  const std::optional<MotionConsensus> consensus = findConsensus(
      matchWholeImage(referencePoints(map), curr, context_, threads_), context_.camera);
  std::optional<Eigen::Isometry3d> T_curr_previous;
  if (consensus) T_curr_previous = consensus->T_curr_prev;
  // The consensus is accurate to a few pixels, so that the first round finds only some landmarks.
  for (int round = 0; round < kRelocalizationRounds && T_curr_previous; ++round) {
    tracked.landmark_matches =
        map.find(curr, context_, map.T_map_previous() * T_curr_previous->inverse(), threads_);
    tracked.motion =
        estimateMotion(map.correspondences(tracked.landmark_matches, context_), context_.camera,
                       *T_curr_previous, parameters_.motion, threads_);
    T_curr_previous =
        tracked.motion.ok() ? std::make_optional(tracked.motion.T_curr_prev) : std::nullopt;
  }
  if (T_curr_previous &&
      isPlaceRecognized(map, tracked.landmark_matches, tracked.motion, kShareRecognized)) {
    const double dt_s = context_.secondsSince(history_.previous->stamp_ns);
    tracked.reason = reasonOf(tracked.motion, dt_s);
  }
  tracked.relocalized = tracked.reason == TrackingReason::kNone;
  return tracked;
}

/// The estimate over two frames is independent of the frame-to-frame one: they run in parallel.
TrackingResult FrameTracker::trackFrameToFrame(const StereoFrame& curr,
                                               const ExpectedMotion& expected) const {
  TrackingResult tracked;
  const int few = parameters_.motion.min_matches;
  if (static_cast<int>(curr.points.size() + curr.lines.size()) < few) {
    tracked.reason = TrackingReason::kTooFewFeatures;
    return tracked;
  }
  const TrackingStages stages;
  MotionEstimate over_two_frames;
  // A prior gives the rotation better than the motion over two frames does.
  if (history_.before_previous && expected.prior == nullptr) {
    threads_->run(2, [&](int task) {
      if (task == 0) {
        tracked = frame_to_frame_.track(*history_.previous, curr, expected, stages, nullptr);
      } else {
        const MotionPrediction& prediction = expected.prediction;
        const ExpectedMotion since_two_frames{
            {prediction.T_curr_prev * history_.before_previous->T_previous_before,
             prediction.radius_px},
            nullptr};
        over_two_frames = frame_to_frame_
                              .track(history_.before_previous->frame, curr, since_two_frames,
                                     {Stage::kTwoFrames, Stage::kTwoFrames}, nullptr)
                              .frame_to_frame;
      }
    });
  } else {
    tracked = frame_to_frame_.track(*history_.previous, curr, expected, stages, threads_);
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

/// Projects the landmarks by the frame-to-frame motion, and estimates the motion against them.
void FrameTracker::trackLocalMap(const StereoFrame& curr, const ExpectedMotion& expected,
                                 TrackingResult* tracked) const {
  const Eigen::Isometry3d& T_curr_previous = tracked->frame_to_frame.ok()
                                                 ? tracked->frame_to_frame.T_curr_prev
                                                 : expected.prediction.T_curr_prev;
  tracked->landmark_matches = history_.map->find(
      curr, context_, history_.map->T_map_previous() * T_curr_previous.inverse(), threads_);
  Correspondences matches = history_.map->correspondences(tracked->landmark_matches, context_);
  const Correspondences& frame_to_frame = tracked->correspondences;
  const auto size = [](const Correspondences& c) {
    return static_cast<double>(c.points.size() + c.lines.size());
  };
  if (size(matches) < kFewMapMatches * size(frame_to_frame)) {
    const MotionEstimate& motion = tracked->frame_to_frame;
    appendMatches(frame_to_frame.points, motion, motion.point_inliers, &matches.points);
    appendMatches(frame_to_frame.lines, motion, motion.line_inliers, &matches.lines);
  }
  const ExpectedMotion near{{T_curr_previous, expected.prediction.radius_px}, expected.prior};
  const MotionEstimate motion =
      estimator_.estimate(matches, near, *history_.previous, threads_, tracked);
  if (motion.ok()) {
    tracked->motion = motion;
  } else {
    tracked->landmark_matches.points.clear();
    tracked->landmark_matches.lines.clear();
  }
}

/// Fuses the motion with the prediction by their covariances (Kalman update) if some axis is better
/// constrained by the prediction; otherwise the prediction is not used. The prior is in the motion
/// already: it is not counted twice.
void FrameTracker::constrainWeakAxes(TrackingResult* tracked) const {
  if (!parameters_.motion.predict_weak_axes || !tracked->motion.ok()) return;
  const double dt_s = context_.secondsSince(history_.previous->stamp_ns);
  const double unmeasured_s = velocity_ ? context_.secondsSince(velocity_->stamp_ns) : dt_s;
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
