#include "odometry/tracking_rounds.h"

#include <optional>
#include <utility>

#include "odometry/frame_shutter.h"
#include "odometry/relocalization.h"
#include "odometry/stage_timer.h"
#include "odometry/stereo_triangulation.h"

namespace point_line_odometry {
namespace {

/// What the frame-to-frame motion says about the right camera, if it is known.
void addCalibrationEvidence(const FrameContext& context, TrackingResult* tracked,
                            StageTimes* times) {
  if (!calibratesStereo(context.parameters) || tracked->reason != TrackingReason::kNone ||
      !tracked->frame_to_frame.ok())
    return;
  const StageTimer timer(times, Stage::kRefine);
  tracked->calibration =
      calibrationEvidence(tracked->correspondences, tracked->frame_to_frame,
                          context.parameters.motion, context.camera, context.correction);
}

}  // namespace

void trackWithShutter(const FramePrior& prior, ThreadPool* threads, OdometryState* state,
                      TrackedFrame* tracked, StageTimes* times) {
  constexpr int kMaxTimes = 3;
  constexpr double kSame_px = 0.05;
  FrameContext& context = tracked->context;
  tracked->tracking = trackOrRelocalize(*state, tracked->frame, prior, context, threads, times);
  const bool knows_previous =
      state->history.previous && state->history.previous->shutter.isMeasured();
  for (int i = 0; i < kMaxTimes && !context.shutter.isGlobal(); ++i) {
    const TrackingResult& tracking = tracked->tracking;
    if (tracking.reason != TrackingReason::kNone || tracking.relocalized) return;
    const RollingShutter used = context.shutter;
    const RollingShutter measured = state->measuredShutter(tracking, context);
    tracked->frame.shutter = measured;
    if ((knows_previous || i > 0) &&
        rmsDifference(measured, used, tracked->frame, context.camera) < kSame_px)
      return;
    context.shutter = measured;
    std::optional<OdometryState> located;
    if (!knows_previous) {
      located = *state;
      located->locateInMotion(context);
    }
    StereoFrame frame = tracked->frame;
    triangulateAgain(context, &frame);
    TrackingResult again =
        trackOrRelocalize(located ? *located : *state, frame, prior, context, threads, times);
    if (again.reason != TrackingReason::kNone || again.relocalized) {
      tracked->frame.shutter = context.shutter = used;
      return;
    }
    again.tried_lost_map |= tracking.tried_lost_map;
    if (located) *state = *std::move(located);
    tracked->frame = std::move(frame);
    tracked->tracking = std::move(again);
  }
}

void recalibrate(const FramePrior& prior, ThreadPool* threads, OdometryState* state,
                 TrackedFrame* tracked, StageTimes* times) {
  constexpr int kMaxTimes = 8;
  addCalibrationEvidence(tracked->context, &tracked->tracking, times);
  for (int i = 0; i < kMaxTimes; ++i) {
    const std::optional<CalibrationEvidence>& shown = tracked->tracking.calibration;
    if (!shown || tracked->tracking.ambiguous) return;
    const StereoCorrection used = tracked->context.correction;
    const StereoCorrection correction =
        state->correctionBy(tracked->frame, shown, tracked->context.parameters);
    const double least_px = i == 0 ? kOtherDisparityPx : StereoCorrection::kCalibratedPx;
    if (commonDifference(correction, used, tracked->context.camera) < least_px) return;
    tracked->context.correction = correction;
    OdometryState corrected = *state;
    corrected.locateAgain(tracked->context);
    StereoFrame frame = tracked->frame;
    triangulateAgain(tracked->context, &frame);
    frame.shutter = tracked->frame.shutter;  // differs by nothing that counts, but is measured
    TrackingResult again =
        trackOrRelocalize(corrected, frame, prior, tracked->context, threads, times);
    addCalibrationEvidence(tracked->context, &again, times);
    if (!again.calibration) {
      tracked->context.correction = used;
      if (i == 0) tracked->tracking.calibration.reset();  // what it shows is refuted
      return;
    }
    *state = std::move(corrected);
    tracked->frame = std::move(frame);
    tracked->tracking = std::move(again);
  }
}

}  // namespace point_line_odometry
