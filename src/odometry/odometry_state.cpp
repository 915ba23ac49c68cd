#include "odometry/odometry_state.h"

#include <cmath>
#include <utility>
#include <vector>

#include "geometry/se3.h"
#include "map/new_landmarks.h"
#include "motion/prior_factor.h"
#include "odometry/motion_confirmation.h"
#include "odometry/motion_prediction.h"
#include "odometry/stage_timer.h"
#include "odometry/stereo_triangulation.h"

namespace point_line_odometry {
namespace {

/// Whether frame k-2 will be needed, for the fusion of rotations.
bool fusesRotation(const Parameters& parameters) {
  const std::string& when = parameters.motion.fuse_rotation;
  return when == "always" || (when == "without_landmarks" && parameters.window.size == 0);
}

/// Whether a frame replaces the previous one. One without a motion does not at first: the next
/// frame may again be matched with the previous one.
bool shouldReplace(const FrameHistory& history, const StereoFrame& curr,
                   const TrackingResult& tracked, const FrameContext& context) {
  if (tracked.by_landmarks) return false;
  if (!history.previous || tracked.reason == TrackingReason::kNone) return true;
  const Parameters& parameters = context.parameters;
  const bool outlived =
      tracked.reason == TrackingReason::kFrameGap ||
      context.secondsSince(history.previous->stamp_ns) > parameters.tracking.max_prediction_s;
  const auto features = static_cast<int>(curr.points.size() + curr.lines.size());
  return outlived && features >= parameters.motion.min_matches;
}

/// Images of a frame that do not change any more.
StereoImages imagesOf(const StereoFrame& frame, const StereoImages& received) {
  const std::vector<cv::Mat>& levels = frame.left_image.levels;
  return {levels.empty() ? received.left.clone() : levels.front(), received.right.clone(),
          received.stamp_ns};
}

/// Of the features in the map's last frame; nothing without a map, or if it has just been started.
std::optional<double> shareOfNew(const std::optional<LocalMap>& map) {
  if (!map || map->shareOfNew() == 1.0) return std::nullopt;
  return map->shareOfNew();
}

/// Makes a motion ambiguous that may as well be another one, and adds the variances of that.
void makeAmbiguous(const Vector6d& variances, TrackingResult* tracked) {
  tracked->motion.covariance.diagonal() += variances;
  if (tracked->image_motion) tracked->image_motion->covariance.diagonal() += variances;
  tracked->ambiguous = true;
}

/// The same where the other one is known: the variances cover both.
void makeAmbiguousWith(const Eigen::Isometry3d& T_curr_prev, TrackingResult* tracked) {
  const Vector6d difference =
      poseDifference(tracked->motion.T_curr_prev.inverse(), T_curr_prev.inverse());
  Vector6d variances;
  variances << Eigen::Vector3d::Constant(difference.head<3>().squaredNorm()),
      Eigen::Vector3d::Constant(difference.tail<3>().squaredNorm());
  makeAmbiguous(variances, tracked);
}

}  // namespace

bool isExpired(const LostMap& lost, std::int64_t stamp_ns, const TrackingParameters& parameters) {
  return toSeconds(stamp_ns - lost.history.previous->stamp_ns) > parameters.relocalization_s;
}

bool calibratesStereo(const Parameters& parameters) {
  return parameters.tracking.refine_calibration && parameters.matching.refine_subpixel;
}

double commonDifference(const StereoCorrection& a, const StereoCorrection& b,
                        const StereoCamera& camera) {
  return std::abs(a.meanPx(camera).x() - b.meanPx(camera).x());
}

void OdometryState::update(StereoFrame curr, const FrameContext& context,
                           const TrackingResult& tracked, const FramePrior& prior,
                           ThreadPool* threads, StageTimes* times) {
  const Parameters& parameters = context.parameters;
  const bool measured = tracked.reason == TrackingReason::kNone && !tracked.ambiguous;
  if (lost && isExpired(*lost, curr.stamp_ns, parameters.tracking)) lost.reset();
  if (lost && tracked.tried_lost_map) lost->tried_ns = curr.stamp_ns;
  const double dt_s = sinceLast(context);
  const bool follows = measured && !spansGap(context);
  updateShutter(tracked, follows && !tracked.weak, context, &curr);
  tracking = pose.update(tracked, history, context, dt_s, prior.ofStep());
  const bool agreed = PriorFactor::agrees(tracked.prior);
  priors.update(prior, tracked.prior.axes > 0 && !tracked.ambiguous, agreed);
  noteStamp(curr.stamp_ns);
  failed_windows = 0;  // the report of this frame has them
  if (parameters.motion.adapt_noise && history.map && measured)
    noise.update(tracked.motion.point_residuals, tracked.motion.line_residuals);
  const bool replaces = shouldReplace(history, curr, tracked, context);
  if (measured) repeated.learn(context.images, pose.isStationary());
  if (measured || replaces) repeated.remember(imagesOf(curr, context.images));
  landmark_frames.add(tracked, measured);
  if (tracked.by_landmarks) {
    const StageTimer timer(times, Stage::kUpdateMap);
    history.map->observe(context, tracked.landmark_matches, tracked.motion, threads);
    return;
  }
  const std::vector<OnlineStereoCalibration::VerticalDisparity> vertical =
      verticalDisparities(curr);
  if (measured && parameters.matching.wide_search) {
    resting.learn(*history.previous, curr, tracked, context);
  } else if (!measured) {
    resting.addLost(dt_s);
  }
  if (replaces) {
    const StageTimer timer(times, Stage::kUpdateMap);
    updatePrevious(std::move(curr), context, tracked, threads);
  }
  if (!calibratesStereo(parameters)) return;
  const StageTimer timer(times, Stage::kRefine);
  updateCalibration(tracked, vertical, parameters.motion.point_noise_px);
}

void OdometryState::updateCalibration(
    const TrackingResult& tracked,
    const std::vector<OnlineStereoCalibration::VerticalDisparity>& vertical, double noise_px) {
  if (tracked.calibration && !tracked.ambiguous)
    stereo_calibration.addMotion(*tracked.calibration, shareOfNew(history.map));
  if (tracked.reason != TrackingReason::kRepeatedImages)
    stereo_calibration.addVerticalDisparities(vertical, noise_px);
}

/// A frame whose own motion is not known leaves no velocity to the next one.
void OdometryState::updateShutter(const TrackingResult& tracked, bool is_known,
                                  const FrameContext& context, StereoFrame* curr) {
  if (is_known) {
    shutter.learn(history.previous->shutter, velocityAtPrevious(context),
                  tracked.motion.T_curr_prev, context.secondsSince(history.previous->stamp_ns));
  } else {
    curr->shutter = curr->shutter.notMeasured();
  }
}

void OdometryState::updatePrevious(StereoFrame curr, const FrameContext& context,
                                   const TrackingResult& tracked, ThreadPool* threads) {
  history.before_previous.reset();
  landmark_frames.setPreviousSpan(
      context.secondsSince(history.previous ? history.previous->stamp_ns : curr.stamp_ns));
  const bool unknown = tracked.reason != TrackingReason::kNone;
  const bool other_place = tracked.ambiguous && spansGap(context);
  if (unknown || other_place) {
    keepLostMap(context.parameters);
    startMap(context.parameters);
    if (tracking != TrackingState::kDegraded) pose.loseVelocity();
  } else {
    if (fusesRotation(context.parameters)) {
      history.before_previous =
          FrameBeforePrevious{std::move(*history.previous), tracked.motion.T_curr_prev};
    }
    if (history.map) {
      history.map->add(curr, context, tracked.landmark_matches, tracked.motion,
                       landmarkCandidates(curr, tracked.matches, tracked.frame_to_frame), threads);
    }
  }
  history.previous = std::move(curr);
  pose.advance();
}

FramePrior OdometryState::prepare(const MotionPrior* prior, std::int64_t curr_stamp_ns) const {
  std::optional<std::int64_t> previous_ns;
  if (history.previous) previous_ns = history.previous->stamp_ns;
  return priors.prepare(prior, stamp_ns, previous_ns, curr_stamp_ns);
}

std::optional<TrackingStart> OdometryState::trackingStart(const FrameContext& context,
                                                          const FramePrior& prior) const {
  if (!history.previous) return std::nullopt;
  const auto velocity = velocityFor(context);
  return TrackingStart{*history.previous, predictMotion(velocity, history.previous->stamp_ns,
                                                        context, prior.ofMotion())};
}

std::optional<CameraVelocity> OdometryState::velocityFor(const FrameContext& context) const {
  auto velocity = pose.velocityFor(context.images.stamp_ns, context.parameters.tracking);
  if (!isCurrent(velocity) || !velocity->since_previous) return velocity;
  const MotionSincePrevious& known = *velocity->since_previous;
  const double last_s = context.secondsSince(velocity->stamp_ns);
  const double dt_s = context.secondsSince(history.previous->stamp_ns);
  const Eigen::Isometry3d T_last_camera = motionAtVelocity(velocity->value, last_s);
  velocity->value = velocityOfMotion(known.T_previous_camera * T_last_camera, dt_s);
  velocity->covariance =
      (last_s * last_s * velocity->covariance + known.covariance) / (dt_s * dt_s);
  return velocity;
}

LineResolution OdometryState::lineResolution(const FrameContext& context) const {
  const bool is_known = history.previous && landmark_frames.isSettled() && !spansGap(context);
  return lineResolutionAfter(is_known ? history.previous->points.size() : 0,
                             context.parameters.lines);
}

bool OdometryState::mayTrackLandmarks(const FrameContext& context) const {
  const TrackingParameters& parameters = context.parameters.tracking;
  if (tracking != TrackingState::kOk || !history.previous || !history.map ||
      parameters.rolling_shutter_ms != 0.0)
    return false;
  if (calibratesStereo(context.parameters) &&
      (!stereo_calibration.knowsVertical() ||
       commonDifference(history.previous->correction, context.correction, context.camera) >=
           kOtherDisparityPx))
    return false;
  // The next frame is matched with the previous one if features are detected in that.
  const double next_s = context.secondsSince(history.previous->stamp_ns) + sinceLast(context);
  if (!landmark_frames.mayFollow(*history.map, next_s, parameters)) return false;
  const auto velocity = velocityFor(context);
  return isCurrent(velocity) && velocity->stamp_ns == *stamp_ns;
}

double OdometryState::sinceLast(const FrameContext& context) const {
  return stamp_ns ? context.secondsSince(*stamp_ns) : 0.0;
}

void OdometryState::noteStamp(std::int64_t curr_stamp_ns) {
  if (stamp_ns) intervals.add(toSeconds(curr_stamp_ns - *stamp_ns));
  stamp_ns = curr_stamp_ns;
}

bool OdometryState::repeatsImages(const FrameContext& context, const FramePrior& prior) const {
  if (!history.previous) return false;
  const bool gap = sinceLast(context) > context.parameters.tracking.max_frame_gap_s;
  if (gap && !repeated.cameraHasNoise()) return false;
  return repeated.areIn(context.images, context.intervals, pose.velocity(), prior.ofMotion());
}

/// Of two lost maps the one with more keyframes is kept.
void OdometryState::keepLostMap(const Parameters& parameters) {
  if (!history.previous || !history.map || parameters.tracking.relocalization_s == 0.0) return;
  if (lost && lost->history.map->numKeyframes() > history.map->numKeyframes()) return;
  lost = LostMap{std::exchange(history, FrameHistory()), pose.anchor(), 0};
}

void OdometryState::predict(std::int64_t curr_stamp_ns, const TrackingParameters& parameters,
                            const FramePrior& prior) {
  landmark_frames.forgetMotion();
  landmark_frames.unsettle();
  tracking = pose.predict(intervals.between(*stamp_ns, curr_stamp_ns), parameters, prior.ofStep());
  noteStamp(curr_stamp_ns);
}

bool OdometryState::leaveOutResting(const StereoFrame& curr, const FrameContext& context,
                                    ThreadPool* threads, TrackingResult* tracked) {
  if (!history.previous || !context.parameters.matching.wide_search) return false;
  const std::optional<RestingBody> body =
      resting.findBeforeScene(*history.previous, curr, *tracked, context, threads);
  if (!resting.confirm(body, *history.previous, curr, context)) {
    coverOtherMotions(body, context, tracked);
    return false;
  }
  resting.leaveOut(&*history.previous);
  history.previous->shutter = history.previous->shutter.notMeasured();
  history.before_previous.reset();
  restartMap(context.parameters);
  pose.loseVelocity();
  return true;
}

void OdometryState::coverOtherMotions(const std::optional<RestingBody>& body,
                                      const FrameContext& context, TrackingResult* tracked) const {
  if (!tracked->frame_to_frame.ok() || tracked->reason != TrackingReason::kNone) return;
  if (body) {
    makeAmbiguousWith(body->T_curr_prev, tracked);
    return;
  }
  if (PriorFactor::usesAllAxes(tracked->prior)) return;
  if (resting.mayHideScene(*history.previous, *tracked, context) ||
      (!predicts(context) && isByChance(*history.previous, context.camera, *tracked)))
    coverUnknownMotion(nullptr, context, tracked);
}

void OdometryState::coverUnsupportedMotion(const FramePrior& prior, const FrameContext& context,
                                           TrackingResult* tracked) const {
  if (tracked->reason != TrackingReason::kNone || tracked->relocalized || tracked->ambiguous)
    return;
  if (PriorFactor::usesAllAxes(tracked->prior)) return;
  if (mayBeOtherPlace(context, *tracked)) {
    const bool agrees = tracked->prior.use == PriorUse::kUsed;
    coverUnknownMotion(agrees ? prior.ofMotion() : nullptr, context, tracked);
    return;
  }
  if (!context.parameters.matching.wide_search) return;
  if (!predicts(context) && shareAgreeing(*tracked) < kShareAgreeing) {
    coverUnknownMotion(nullptr, context, tracked);
  } else if (tracked->T_curr_prev_other) {
    makeAmbiguousWith(*tracked->T_curr_prev_other, tracked);
  }
}

bool OdometryState::mayBeOtherPlace(const FrameContext& context,
                                    const TrackingResult& tracked) const {
  if (!spansGap(context)) return false;
  if (!history.map || history.map->shareFound() == 0.0)
    return shareFound(*history.previous, context.camera, tracked) < kShareConfirmed;
  return !isPlaceRecognized(*history.map, tracked.landmark_matches, tracked.motion,
                            kShareConfirmed);
}

/// Whether there has been no motion for so long that the camera may be at another place.
bool OdometryState::spansGap(const FrameContext& context) const {
  return context.secondsSince(history.previous->stamp_ns) >
         context.parameters.tracking.max_frame_gap_s;
}

/// Whether a current velocity predicts the frame's motion.
bool OdometryState::predicts(const FrameContext& context) const {
  return isCurrent(velocityFor(context));
}

/// Makes a motion ambiguous that may be any with which a prior (null: none) agrees.
void OdometryState::coverUnknownMotion(const MotionPrior* prior, const FrameContext& context,
                                       TrackingResult* tracked) const {
  const double dt_s = context.secondsSince(history.previous->stamp_ns);
  const std::optional<CameraVelocity>& velocity = pose.velocity();
  const double unmeasured_s = velocity ? context.secondsSince(velocity->stamp_ns) : dt_s;
  const Matrix6d covariance =
      covarianceOfUnknownMotion(velocity, dt_s, unmeasured_s, context.parameters.tracking);
  makeAmbiguous((prior ? fusedCovariance(covariance, prior->information) : covariance).diagonal(),
                tracked);
}

RollingShutter OdometryState::predictedShutter(const FrameContext& context) const {
  const auto velocity = pose.velocityFor(context.images.stamp_ns, context.parameters.tracking);
  const double unmeasured_s =
      velocity ? context.secondsSince(velocity->stamp_ns) : sinceLast(context);
  return shutter.predicted(velocity, unmeasured_s, context.parameters);
}

RollingShutter OdometryState::measuredShutter(const TrackingResult& tracked,
                                              const FrameContext& context) const {
  return shutter.measured(tracked.motion.T_curr_prev,
                          context.secondsSince(history.previous->stamp_ns),
                          velocityAtPrevious(context), context.parameters);
}

/// Not current unless it is from the motion to the previous frame.
std::optional<CameraVelocity> OdometryState::velocityAtPrevious(const FrameContext& context) const {
  auto velocity = pose.velocityFor(context.images.stamp_ns, context.parameters.tracking);
  if (velocity && velocity->stamp_ns != history.previous->stamp_ns) velocity->is_current = false;
  return velocity;
}

void OdometryState::locateInMotion(const FrameContext& context) {
  FrameContext of_previous = context;
  of_previous.correction = history.previous->correction;
  locatePrevious(of_previous);
}

StereoCorrection OdometryState::correctionBy(const StereoFrame& curr,
                                             const std::optional<CalibrationEvidence>& motion,
                                             const Parameters& parameters) const {
  OnlineStereoCalibration calibration = stereo_calibration;
  if (motion) calibration.addMotion(*motion, shareOfNew(history.map));
  calibration.addVerticalDisparities(verticalDisparities(curr), parameters.motion.point_noise_px);
  return calibration.correction();
}

void OdometryState::locateAgain(const FrameContext& context) {
  FrameContext of_previous = context;
  of_previous.shutter = history.previous->shutter;
  locatePrevious(of_previous);
  restartMap(context.parameters);
}

void OdometryState::locatePrevious(const FrameContext& context) {
  triangulateAgain(context, &*history.previous);
  history.before_previous.reset();
}

void OdometryState::followCorrection(const FrameContext& context) {
  if (!history.previous) return;
  const double difference_px =
      commonDifference(history.previous->correction, context.correction, context.camera);
  if (difference_px >= kOtherDisparityPx) locateAgain(context);
}

void OdometryState::returnToLostMap() {
  landmark_frames.forgetMotion();
  history = std::move(lost->history);
  pose.returnTo(lost->anchor);
  lost.reset();
}

void OdometryState::restartTracking() {
  landmark_frames.forgetMotion();
  history = FrameHistory();
  lost.reset();
}

void OdometryState::continueAt(const Eigen::Isometry3d& T_odom_camera) {
  restartTracking();
  pose.continueAt(T_odom_camera);
  tracking = TrackingState::kInitializing;
  stamp_ns.reset();
  intervals = FrameIntervals();
}

void OdometryState::restartMap(const Parameters& parameters) {
  lost.reset();
  startMap(parameters);
  pose.startMapAtPrevious();
}

void OdometryState::startMap(const Parameters& parameters) {
  landmark_frames.unsettle();
  history.map.reset();
  if (parameters.window.size > 0) history.map.emplace();
  pose.startMap();
}

}  // namespace point_line_odometry
