#include "point_line_odometry/stereo_odometry.h"

#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>

#include "common/thread_pool.h"
#include "features/feature_mask.h"
#include "features/stereo_feature_detector.h"
#include "motion/frame_context.h"
#include "odometry/coarser_points.h"
#include "odometry/frame_report.h"
#include "odometry/frame_shutter.h"
#include "odometry/frame_tracker.h"
#include "odometry/image_scaling.h"
#include "odometry/odometry_state.h"
#include "odometry/stage_timer.h"
#include "odometry/state_archive.h"
#include "odometry/stereo_frame_builder.h"
#include "odometry/stereo_triangulation.h"
#include "odometry/tilt.h"
#include "odometry/tracking_rounds.h"
#include "odometry/window_adjustment.h"

namespace point_line_odometry {
namespace {

void requireFinite(const Eigen::Isometry3d& pose) {
  if (!pose.matrix().allFinite()) throw std::invalid_argument("a pose of the camera is not finite");
}

}  // namespace

/// The pipeline, as in the diagram of doc/how_it_works.md: track() and update() are one frame.
class StereoOdometry::Impl {
 public:
  Impl(const StereoCamera& camera, const Parameters& parameters)
      : input_camera((camera.validate(), camera)),
        parameters(validated(parameters)),
        scaling(camera, parameters.tracking),
        threads(std::make_unique<ThreadPool>(parameters.tracking.threads)),
        detector(parameters.points, parameters.lines),
        state(scaling.camera()) {}

  FrameResult process(const StereoImages& images, const MotionPrior* given);
  void reset(const Eigen::Isometry3d& T_odom_camera);
  void continueAt(const Eigen::Isometry3d& T_odom_camera);
  void setCamera(const StereoCamera& camera);
  void setParameters(const Parameters& wanted);
  std::string saveState();
  void restoreState(const std::string& bytes);

  StereoCamera input_camera;
  Parameters parameters;
  ImageScaling scaling;
  std::unique_ptr<ThreadPool> threads;
  StereoFeatureDetector detector;
  StereoMaskCache masks;
  OdometryState state;
  WindowAdjustment window;  // of the state's map, in parallel to the next frame's first stages

 private:
  void process(const StereoImages& received, const FramePrior& prior, FrameResult* result);
  std::optional<TrackedFrame> trackLandmarks(const FrameContext& detecting, const FramePrior& prior,
                                             FrameResult* result);
  TrackedFrame track(StereoFrame detected, FrameContext context, const FramePrior& prior,
                     FrameResult* result);
  void finishWindow(FrameResult* result);
  void update(TrackedFrame curr, const FramePrior& prior, FrameResult* result);
  void giveUp(const char* error, const FramePrior& prior, FrameResult* result);
  void restartTracking();
};

FrameResult StereoOdometry::Impl::process(const StereoImages& images, const MotionPrior* given) {
  const auto begin = StageTimer::Clock::now();
  FrameResult result;
  result.stamp_ns = images.stamp_ns;
  result.reason = refusal(images, input_camera, state.stamp_ns);
  if (result.accepted()) {
    const FramePrior prior = state.prepare(given, images.stamp_ns);
    try {
      process(scaling.scale(images), prior, &result);
      scaling.toInputPixels(&result);
    } catch (const std::exception& error) {
      giveUp(error.what(), prior, &result);
    }
    result.times.total_ms = StageTimer::elapsedMs(begin);
  }
  state.pose.report(state.tracking, parameters.tracking, &result);
  return result;
}

void StereoOdometry::Impl::process(const StereoImages& received, const FramePrior& prior,
                                   FrameResult* result) {
  const StereoMasks& masks_now = masks.of(received);
  const StereoImages images = masks_now.paint(received);
  FrameContext context{images,     scaling.camera(), state.stereo_calibration.correction(),
                       parameters, state.noise,      state.intervals};
  context.masks = masks_now;

  if (state.repeatsImages(context, prior)) {
    TrackedFrame repeated{context, {}, {}};
    repeated.frame.stamp_ns = images.stamp_ns;
    repeated.tracking.reason = TrackingReason::kRepeatedImages;
    finishWindow(result);
    update(std::move(repeated), prior, result);
    return;
  }
  if (std::optional<TrackedFrame> tracked = trackLandmarks(context, prior, result)) {
    update(*std::move(tracked), prior, result);
    return;
  }
  const StereoFrame detected = detectFeatures(&detector, state.lineResolution(context), context,
                                              threads.get(), &result->times);
  if (calibratesStereo(parameters) && !state.stereo_calibration.knowsVertical()) {
    const StereoFrame first =
        matchFeatures(detected, &detector, state.trackingStart(context, prior), &context,
                      threads.get(), &result->times);
    context.correction = state.correctionBy(first, {}, parameters);
  }
  TrackedFrame curr = track(detected, context, prior, result);
  const PriorReport prior_report = curr.tracking.prior;
  if (prior_report.use != PriorUse::kRejected || !hasCoarserPoints(curr.frame)) {
    update(std::move(curr), prior, result);
    return;
  }
  // Points of coarser levels were searched where the rejected prior predicted them.
  context.correction = curr.context.correction;
  TrackedFrame without_prior = track(detected, context, {}, result);
  if (without_prior.tracking.image_motion) without_prior.tracking.prior = prior_report;
  update(std::move(without_prior), prior, result);
}

/// Tracks the frame by landmarks alone, if that is in no doubt.
std::optional<TrackedFrame> StereoOdometry::Impl::trackLandmarks(const FrameContext& detecting,
                                                                 const FramePrior& prior,
                                                                 FrameResult* result) {
  if (!state.mayTrackLandmarks(detecting)) return std::nullopt;
  finishWindow(result);
  FrameContext context = detecting;  // to which levels are added
  addLevels(&context, threads.get());
  const auto velocity = state.velocityFor(context);
  const FrameTracker tracker(state.history, velocity, prior, context, threads.get(),
                             &result->times);
  std::optional<TrackingResult> tracked = tracker.trackLandmarks();
  if (!tracked) return std::nullopt;
  TrackedFrame frame{std::move(context), {}, *std::move(tracked)};
  frame.frame.stamp_ns = frame.context.images.stamp_ns;
  return frame;
}

TrackedFrame StereoOdometry::Impl::track(StereoFrame detected, FrameContext context,
                                         const FramePrior& prior, FrameResult* result) {
  // Match left with right, triangulate.
  const auto start = state.trackingStart(context, prior);
  context.shutter = state.predictedShutter(context);
  StereoFrame frame =
      matchFeatures(std::move(detected), &detector, start, &context, threads.get(), &result->times);

  finishWindow(result);

  // Match with the previous frame and the map, estimate the motion.
  state.followCorrection(context);
  state.resting.leaveOut(&frame);
  TrackedFrame tracked{std::move(context), std::move(frame), {}};
  trackWithShutter(prior, threads.get(), &state, &tracked, &result->times);
  // Of a body that is found, parts may still be in the way.
  constexpr int kMaxParts = 3;
  int parts = 0;
  while (parts < kMaxParts &&
         state.leaveOutResting(tracked.frame, tracked.context, threads.get(), &tracked.tracking)) {
    ++parts;
    state.resting.leaveOut(&tracked.frame);
    if (!tracked.context.shutter.isGlobal()) {  // it was that of the body's motion
      tracked.context.shutter = state.predictedShutter(tracked.context);
      triangulateAgain(tracked.context, &tracked.frame);
    }
    trackWithShutter(prior, threads.get(), &state, &tracked, &result->times);
  }
  if (parts == kMaxParts) state.coverOtherMotions(std::nullopt, tracked.context, &tracked.tracking);
  recalibrate(prior, threads.get(), &state, &tracked, &result->times);
  state.coverUnsupportedMotion(prior, tracked.context, &tracked.tracking);
  return tracked;
}

/// Applies the bundle adjustment that ran meanwhile to the map.
void StereoOdometry::Impl::finishWindow(FrameResult* result) {
  const StageTimer timer(&result->times, Stage::kWindow);
  state.failed_windows += window.finish(&state.history.map);
}

void StereoOdometry::Impl::update(TrackedFrame curr, const FramePrior& prior, FrameResult* result) {
  if (curr.tracking.in_lost_map) state.returnToLostMap();
  reportTracking(state, curr.frame, curr.context, curr.tracking, result);
  state.update(std::move(curr.frame), curr.context, curr.tracking, prior, threads.get(),
               &result->times);
  result->prior = reportPrior(state, curr.tracking, prior);
  const StageTimer timer(&result->times, Stage::kUpdateMap);
  window.start(curr.context.camera, parameters, &state.history.map);
}

void StereoOdometry::Impl::giveUp(const char* error, const FramePrior& prior, FrameResult* result) {
  if (state.stamp_ns == result->stamp_ns) {
    restartTracking();
    state.tracking = TrackingState::kDegraded;
  } else if (state.stamp_ns) {
    state.predict(result->stamp_ns, parameters.tracking, prior);
    TrackingResult none;
    none.reason = TrackingReason::kException;
    result->prior = reportPrior(state, none, prior);
  } else {
    state.noteStamp(result->stamp_ns);
  }
  result->points.clear();  // perhaps of a scaled image
  result->lines.clear();
  result->unmatched_points_px.clear();
  result->reason = TrackingReason::kException;
  result->error = error;
}

void StereoOdometry::Impl::reset(const Eigen::Isometry3d& T_odom_camera) {
  requireFinite(T_odom_camera);
  window.discard();
  state = OdometryState(scaling.camera(), T_odom_camera);
}

void StereoOdometry::Impl::continueAt(const Eigen::Isometry3d& T_odom_camera) {
  requireFinite(T_odom_camera);
  window.discard();
  state.continueAt(T_odom_camera);
}

void StereoOdometry::Impl::restartTracking() {
  window.discard();
  state.restartTracking();
}

/// For images of another camera or size only the pose remains valid.
void StereoOdometry::Impl::setCamera(const StereoCamera& camera) {
  camera.validate();
  input_camera = camera;
  scaling = ImageScaling(camera, parameters.tracking);
  state.stereo_calibration = OnlineStereoCalibration(scaling.camera());
  state.noise = NoiseScale();
  state.resting = RestingFeatures(scaling.camera());
  state.repeated = RepeatedImages();
  state.shutter = FrameShutter();
  state.intervals = FrameIntervals();
  restartTracking();
}

/// What may throw comes first: nothing is changed then.
void StereoOdometry::Impl::setParameters(const Parameters& wanted) {
  const Parameters checked = validated(wanted);
  auto new_threads = std::make_unique<ThreadPool>(wanted.tracking.threads);
  StereoFeatureDetector new_detector(wanted.points, wanted.lines);
  const Parameters before = std::exchange(parameters, checked);
  threads = std::move(new_threads);
  detector = std::move(new_detector);
  if (!wanted.motion.adapt_noise || wanted.window.size == 0) state.noise = NoiseScale();
  if (!calibratesStereo(wanted))
    state.stereo_calibration = OnlineStereoCalibration(scaling.camera());
  if (!wanted.matching.wide_search) state.resting = RestingFeatures(scaling.camera());
  if (ImageScaling(input_camera, wanted.tracking).camera() != scaling.camera())
    setCamera(input_camera);
  // Descriptors, the sizes of the levels in which points were found, or positions mean something
  // else.
  if (isChanged(before, wanted, "points/descriptor") ||
      isChanged(before, wanted, "points/scale_factor") ||
      isChanged(before, wanted, "tracking/rolling_shutter_ms"))
    restartTracking();
  if (isChanged(before, wanted, "window/") || isChanged(before, wanted, "local_map/")) {
    window.discard();
    state.restartMap(wanted);
  }
}

std::string StereoOdometry::Impl::saveState() {
  state.failed_windows += window.finish(&state.history.map);
  return toBytes(state);
}

void StereoOdometry::Impl::restoreState(const std::string& bytes) {
  OdometryState restored(scaling.camera());
  fromBytes(bytes, &restored);
  window.discard();
  state = std::move(restored);
}

StereoOdometry::StereoOdometry(const StereoCamera& camera, const Parameters& parameters)
    : impl_(std::make_unique<Impl>(camera, parameters)) {}
StereoOdometry::~StereoOdometry() = default;
StereoOdometry::StereoOdometry(StereoOdometry&&) noexcept = default;
StereoOdometry& StereoOdometry::operator=(StereoOdometry&&) noexcept = default;

FrameResult StereoOdometry::process(const StereoImages& images, const MotionPrior* prior) {
  return impl_->process(images, prior);
}
bool StereoOdometry::correctTilt(const TiltCorrection& correction) {
  if (!isUsable(correction)) return false;
  impl_->state.pose.correctTilt(correction);
  return true;
}
void StereoOdometry::reset(const Eigen::Isometry3d& T_odom_camera) { impl_->reset(T_odom_camera); }
void StereoOdometry::continueAt(const Eigen::Isometry3d& T_odom_camera) {
  impl_->continueAt(T_odom_camera);
}
void StereoOdometry::setCamera(const StereoCamera& camera) { impl_->setCamera(camera); }
void StereoOdometry::setParameters(const Parameters& wanted) { impl_->setParameters(wanted); }
std::string StereoOdometry::saveState() { return impl_->saveState(); }
void StereoOdometry::restoreState(const std::string& bytes) { impl_->restoreState(bytes); }
const StereoCamera& StereoOdometry::camera() const { return impl_->input_camera; }
const Parameters& StereoOdometry::parameters() const { return impl_->parameters; }
LineDetectorKind StereoOdometry::lineDetector() const { return impl_->detector.lineDetector(); }
const StereoCorrection& StereoOdometry::correction() const {
  return impl_->state.stereo_calibration.correction();
}

}  // namespace point_line_odometry
