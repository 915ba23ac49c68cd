#include "odometry/relocalization.h"

#include <optional>
#include <utility>

#include "odometry/frame_tracker.h"

namespace point_line_odometry {
namespace {

// Interval of relocalization in the lost map while the camera is tracked in another.
constexpr double kRetry_s = 0.5;

TrackingResult without(TrackingReason reason) {
  TrackingResult nothing;
  nothing.reason = reason;
  return nothing;
}

/// A prior that rejects the motion to a place that may be another one carries the pose instead.
bool isContradicted(const TrackingResult& tracked, const OdometryState& state,
                    const FrameContext& context) {
  return tracked.reason == TrackingReason::kNone && !tracked.relocalized &&
         tracked.prior.use == PriorUse::kRejected && state.mayBeOtherPlace(context, tracked);
}

/// After a gap the map is tried first: where it is recognized, the place is certain.
TrackingResult trackCurrentMap(const OdometryState& state, const StereoFrame& curr,
                               const FramePrior& prior, const FrameContext& context,
                               ThreadPool* threads, StageTimes* times) {
  if (!state.history.previous) return without(TrackingReason::kFirstFrame);
  const TrackingParameters& parameters = context.parameters.tracking;
  const std::optional<CameraVelocity> velocity = state.velocityFor(context);
  const FrameTracker tracker(state.history, velocity, prior, context, threads, times);
  const double dt_s = state.sinceLast(context);
  const auto is_reachable = [&](const TrackingResult& tracked) {
    const Eigen::Isometry3d T_odom_camera =
        state.pose.anchor().T_odom_previous * tracked.motion.T_curr_prev.inverse();
    return state.pose.isReachable(T_odom_camera, dt_s, parameters);
  };
  if (dt_s <= parameters.max_frame_gap_s) {
    TrackingResult tracked = tracker.track(curr);
    const bool refused =
        (tracked.relocalized && !is_reachable(tracked)) || isContradicted(tracked, state, context);
    return refused ? without(TrackingReason::kTooFewInliers) : tracked;
  }
  TrackingResult tracked = tracker.relocalize(curr);
  if (!tracked.relocalized || !is_reachable(tracked)) tracked = tracker.track(curr);
  const bool found = tracked.reason == TrackingReason::kNone && is_reachable(tracked) &&
                     !isContradicted(tracked, state, context);
  return found ? tracked : without(TrackingReason::kFrameGap);
}

/// Nothing unless the camera is relocalized in the lost map.
std::optional<TrackingResult> relocalizeInLostMap(const OdometryState& state,
                                                  const StereoFrame& curr,
                                                  const FrameContext& context, ThreadPool* threads,
                                                  StageTimes* times) {
  const LostMap& lost = *state.lost;
  const std::optional<CameraVelocity> unknown;
  const FramePrior none;
  const FrameTracker tracker(lost.history, unknown, none, context, threads, times);
  TrackingResult tracked = tracker.relocalize(curr);
  if (!tracked.relocalized) return std::nullopt;
  const Eigen::Isometry3d T_odom_camera =
      lost.anchor.T_odom_previous * tracked.motion.T_curr_prev.inverse();
  const double dt_s = state.sinceLast(context);
  if (!state.pose.isReachable(T_odom_camera, dt_s, context.parameters.tracking))
    return std::nullopt;
  tracked.in_lost_map = true;
  return tracked;
}

}  // namespace

TrackingResult trackOrRelocalize(const OdometryState& state, const StereoFrame& curr,
                                 const FramePrior& prior, const FrameContext& context,
                                 ThreadPool* threads, StageTimes* times) {
  TrackingResult tracked = trackCurrentMap(state, curr, prior, context, threads, times);
  if (tracked.relocalized || !state.lost) return tracked;
  const bool measured = tracked.reason == TrackingReason::kNone;
  if (measured && toSeconds(curr.stamp_ns - state.lost->tried_ns) < kRetry_s) return tracked;
  if (isExpired(*state.lost, curr.stamp_ns, context.parameters.tracking)) return tracked;
  if (auto found = relocalizeInLostMap(state, curr, context, threads, times)) return *found;
  tracked.tried_lost_map = true;
  return tracked;
}

}  // namespace point_line_odometry
