#include "point_line_odometry/stereo_odometry.h"

#include <algorithm>
#include <cmath>
#include <future>
#include <optional>
#include <stdexcept>
#include <utility>

#include "map/bundle_adjustment.h"
#include "map/local_map.h"
#include "motion/camera_motion.h"
#include "motion/sights.h"
#include "odometry/correspondences.h"
#include "odometry/parameter_checker.h"
#include "odometry/stage_timer.h"
#include "odometry/state_archive.h"
#include "odometry/steady_pose.h"
#include "odometry/uncertainty.h"
#include "point_line_odometry/matching.h"
#include "point_line_odometry/motion.h"
#include "point_line_odometry/pose_integrator.h"
#include "point_line_odometry/stereo_feature_detector.h"
#include "point_line_odometry/thread_pool.h"

namespace point_line_odometry {
namespace {

constexpr double kMaxWidening = 4.0;  // of the search radius after missing frames

// If the map gives fewer matches than this share of those with the last frame, these are used, too.
constexpr double kFewMapMatches = 0.5;

// How far a frame's motion may be changed by what the map has corrected, in standard deviations.
constexpr double kMaxCorrectionSigmas = 3.0;

// Errors of successive motions are alike, as they come from the same features: so many times a
// motion's covariance is handed on to the next poses, from frame to frame; and of a motion against
// the map, times the share of landmarks that are new. Measured in the built-in worlds (NEES).
constexpr double kLastingDirect = 3.0;
constexpr double kLastingOfNew = 6.0;

double seconds(std::int64_t ns) { return 1e-9 * static_cast<double>(ns); }

/// Appends the matches of one kind that agree with a motion; all of them if there is none.
template <typename Correspondence>
void appendMatches(const std::vector<Correspondence>& matches, const MotionEstimate& motion,
                   const std::vector<bool>& inliers, std::vector<Correspondence>* list) {
  for (std::size_t i = 0; i < matches.size(); ++i) {
    if (!motion.ok() || inliers[i]) list->push_back(matches[i]);
  }
}

Parameters checked(const Parameters& parameters) {
  const std::vector<std::string> errors = checkParameters(parameters);
  if (!errors.empty()) throw std::invalid_argument("parameters: " + join(errors, "; "));
  return parameters;
}

bool fits(const cv::Mat& image, const StereoCamera& camera) {
  return image.type() == CV_8UC1 && image.cols == camera.width && image.rows == camera.height;
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

class StereoOdometry::Impl {
 public:
  Impl(const StereoCamera& camera, const Parameters& parameters);

  FrameResult process(const StereoImages& images);
  void reset(const Eigen::Isometry3d& T_odom_camera);
  void setCamera(const StereoCamera& camera);
  void setParameters(const Parameters& parameters);
  std::string saveState();
  void restoreState(const std::string& bytes);
  const StereoCamera& camera() const { return camera_; }
  const Parameters& parameters() const { return parameters_; }
  const RightImageCorrection& correction() const { return refinement_.correction(); }

 private:
  /// What earlier frames and the current one say about the motion since the reference.
  struct Measurement {
    TrackingReason reason = TrackingReason::kNone;  // kNone: the motion is measured
    CircularMatches matches;                        // (reference, current)
    Correspondences correspondences;
    MotionEstimate direct;  // from these alone
    MotionEstimate motion;  // the best one: against the map if there is one
    MapSights sights;
  };

  /// Where the times of a measurement go.
  struct MeasureTimes {
    StageTimes* times;
    Stage match;
    Stage estimate;
  };

  struct EarlierFrame {
    StereoFrame frame;
    Eigen::Isometry3d T_reference_before = Eigen::Isometry3d::Identity();  // motion k-2 -> k-1

    auto state() {
      auto& [frame_of_this, T] = *this;
      return std::tie(frame_of_this, T);
    }
  };

  void track(const StereoImages& images, double dt_s, FrameResult* result);
  StereoFrame makeFrame(const FrameContext& context, StageTimes* times);
  Measurement measure(const StereoFrame& curr, const FrameContext& context,
                      StageTimes* times) const;
  Measurement measureDirectly(const StereoFrame& curr, const FrameContext& context,
                              const MotionPrediction& prediction, StageTimes* times) const;
  Measurement measureSince(const StereoFrame& earlier, const StereoFrame& curr,
                           const FrameContext& context, const MotionPrediction& prediction,
                           const MeasureTimes& times, ThreadPool* threads) const;
  void measureAgainstMap(const StereoFrame& curr, const FrameContext& context,
                         const MotionPrediction& prediction, Measurement* measurement) const;
  MotionEstimate estimate(const Correspondences& matches, const Eigen::Isometry3d& T_curr_prev,
                          const StereoFrame& prev, const StereoFrame& curr) const;
  TrackingReason reasonOf(const MotionEstimate& motion, double dt_s) const;
  MotionPrediction predict(double dt_s) const;
  void integrate(const Measurement& measurement, std::int64_t stamp_ns, double dt_s);
  void integratePrediction(std::int64_t stamp_ns, double dt_s);
  MotionStep stepOf(const Measurement& measurement) const;
  bool shouldBecomeReference(const StereoFrame& curr, const Measurement& measurement) const;
  void takeReference(StereoFrame curr, const FrameContext& context, const Measurement& measurement);
  static LandmarkCandidates candidatesOf(const Measurement& measurement);
  void startWindow();
  void finishWindow();
  void report(const StereoFrame& curr, const Measurement& measurement, FrameResult* result) const;
  void reportPose(FrameResult* result) const;
  FrameResult dropped(TrackingReason reason, FrameResult result) const;
  void giveUp(const char* error, double dt_s, FrameResult* result);
  void refineCalibration(const StereoFrame& curr, const Measurement& measurement);
  void startNewReference();
  void startNewMap();
  template <typename Archive>
  void visitState(Archive* archive);

  StereoCamera camera_;
  Parameters parameters_;
  std::unique_ptr<ThreadPool> threads_;
  StereoFeatureDetector detector_;
  CalibrationRefinement refinement_;

  // State.
  TrackingState state_ = TrackingState::kInitializing;
  std::optional<StereoFrame> reference_;  // frame k-1: the last one that others can be matched with
  std::optional<EarlierFrame> before_reference_;  // frame k-2, kept for the fusion of rotations
  std::optional<LocalMap> map_;                   // nothing without a window
  Eigen::Isometry3d T_odom_map_ = Eigen::Isometry3d::Identity();
  std::future<std::optional<BundleProblem>> window_;  // solved beside the next frame's first stages
  PoseIntegrator pose_;
  SteadyPose output_;
  std::optional<std::int64_t> last_stamp_ns_;  // of the last accepted frame
};

StereoOdometry::Impl::Impl(const StereoCamera& camera, const Parameters& parameters)
    : camera_((camera.validate(), camera)),
      parameters_(checked(parameters)),
      threads_(std::make_unique<ThreadPool>(parameters.tracking.threads)),
      detector_(parameters.points, parameters.lines),
      refinement_(camera) {
  startNewReference();
}

FrameResult StereoOdometry::Impl::process(const StereoImages& images) {
  const auto begin = StageTimer::Clock::now();
  FrameResult result;
  result.stamp_ns = images.stamp_ns;
  if (!fits(images.left, camera_) || !fits(images.right, camera_)) {
    return dropped(TrackingReason::kWrongImages, std::move(result));
  }
  if (last_stamp_ns_ && images.stamp_ns <= *last_stamp_ns_) {
    return dropped(TrackingReason::kStampNotNewer, std::move(result));
  }
  const double dt_s = last_stamp_ns_ ? seconds(images.stamp_ns - *last_stamp_ns_) : 0.0;
  try {
    track(images, dt_s, &result);
  } catch (const std::exception& error) {
    giveUp(error.what(), dt_s, &result);
  }
  result.times.total_ms = StageTimer::elapsedMs(begin);
  return result;
}

void StereoOdometry::Impl::track(const StereoImages& images, double dt_s, FrameResult* result) {
  const RightImageCorrection correction = refinement_.correction();
  const FrameContext context{images, camera_, correction, parameters_};
  StereoFrame curr = makeFrame(context, &result->times);
  {
    const StageTimer timer(&result->times, Stage::kWindow);
    finishWindow();
  }
  const bool gap = reference_ && dt_s > parameters_.tracking.max_frame_gap_s;
  Measurement measurement;
  measurement.reason = gap ? TrackingReason::kFrameGap : TrackingReason::kFirstFrame;
  if (reference_ && !gap) measurement = measure(curr, context, &result->times);
  report(curr, measurement, result);
  integrate(measurement, curr.stamp_ns, dt_s);
  last_stamp_ns_ = curr.stamp_ns;
  reportPose(result);

  // What the next frames will need.
  if (parameters_.tracking.refine_calibration) {
    const StageTimer timer(&result->times, Stage::kRefine);
    refineCalibration(curr, measurement);
  }
  if (shouldBecomeReference(curr, measurement)) {
    const StageTimer timer(&result->times, Stage::kLearn);
    takeReference(std::move(curr), context, measurement);
    startWindow();
  }
}

StereoFrame StereoOdometry::Impl::makeFrame(const FrameContext& context, StageTimes* times) {
  StereoFrame frame;
  frame.stamp_ns = context.images.stamp_ns;
  {
    const StageTimer timer(times, Stage::kDetect);
    context.images.left.copyTo(frame.left_image);
    frame.features = detector_.detect(context.images, threads_.get());
  }
  StereoMatches matches;
  {
    const StageTimer timer(times, Stage::kMatchStereo);
    matches = matchStereo(frame.features, parameters_.matching, threads_.get());
  }
  const StageTimer timer(times, Stage::kTriangulate);
  triangulateMatches(matches, context, threads_.get(), &frame);
  return frame;
}

StereoOdometry::Impl::Measurement StereoOdometry::Impl::measure(const StereoFrame& curr,
                                                                const FrameContext& context,
                                                                StageTimes* times) const {
  const double dt_s = seconds(curr.stamp_ns - reference_->stamp_ns);
  const MotionPrediction prediction = predict(dt_s);
  Measurement measurement = measureDirectly(curr, context, prediction, times);
  if (map_) {
    const StageTimer timer(times, Stage::kMap);
    measureAgainstMap(curr, context, prediction, &measurement);
  }
  if (measurement.motion.ok()) measurement.reason = reasonOf(measurement.motion, dt_s);
  return measurement;
}

/// The estimate over two frames needs nothing of the direct one: they are made side by side.
StereoOdometry::Impl::Measurement StereoOdometry::Impl::measureDirectly(
    const StereoFrame& curr, const FrameContext& context, const MotionPrediction& prediction,
    StageTimes* times) const {
  Measurement measurement;
  const int few = parameters_.motion.min_matches;
  if (static_cast<int>(curr.points.size() + curr.lines.size()) < few) {
    measurement.reason = TrackingReason::kTooFewFeatures;
    return measurement;
  }
  const MeasureTimes direct_times{times, Stage::kMatchCircular, Stage::kEstimate};
  MotionEstimate over_two;
  if (before_reference_) {
    threads_->run(2, [&](int task) {
      if (task == 0) {
        measurement = measureSince(*reference_, curr, context, prediction, direct_times, nullptr);
      } else {
        const MotionPrediction since_two_frames{
            prediction.T_curr_prev * before_reference_->T_reference_before, prediction.radius_px};
        over_two = measureSince(before_reference_->frame, curr, context, since_two_frames,
                                {times, Stage::kTwoFrames, Stage::kTwoFrames}, nullptr)
                       .direct;
      }
    });
  } else {
    measurement =
        measureSince(*reference_, curr, context, prediction, direct_times, threads_.get());
  }
  measurement.motion = measurement.direct;
  if (measurement.direct.ok() && over_two.ok()) {
    const StageTimer timer(times, Stage::kFuse);
    measurement.motion = measurement.direct = fuseRotation(
        measurement.direct, over_two.T_curr_prev, before_reference_->T_reference_before,
        measurement.correspondences, camera_, parameters_.motion);
  }
  measurement.reason = trackingReason(measurement.direct.status);
  return measurement;
}

StereoOdometry::Impl::Measurement StereoOdometry::Impl::measureSince(
    const StereoFrame& earlier, const StereoFrame& curr, const FrameContext& context,
    const MotionPrediction& prediction, const MeasureTimes& times, ThreadPool* threads) const {
  Measurement measurement;
  {
    const StageTimer timer(times.times, times.match);
    measurement.matches = matchCircular(earlier, curr, camera_, prediction, parameters_.matching);
    measurement.correspondences = makeCorrespondences(earlier, curr, measurement.matches,
                                                      prediction.T_curr_prev, context, threads);
  }
  const StageTimer timer(times.times, times.estimate);
  measurement.direct = estimate(measurement.correspondences, prediction.T_curr_prev, earlier, curr);
  return measurement;
}

/// The direct motion says where the landmarks are expected; they say where the camera is.
void StereoOdometry::Impl::measureAgainstMap(const StereoFrame& curr, const FrameContext& context,
                                             const MotionPrediction& prediction,
                                             Measurement* measurement) const {
  const Eigen::Isometry3d& T_curr_reference =
      measurement->direct.ok() ? measurement->direct.T_curr_prev : prediction.T_curr_prev;
  measurement->sights = map_->find(
      curr, context, map_->T_map_reference() * T_curr_reference.inverse(), threads_.get());
  Correspondences matches = map_->correspondences(measurement->sights);
  const Correspondences& direct = measurement->correspondences;
  const auto size = [](const Correspondences& c) {
    return static_cast<double>(c.points.size() + c.lines.size());
  };
  if (size(matches) < kFewMapMatches * size(direct)) {
    const MotionEstimate& motion = measurement->direct;
    appendMatches(direct.points, motion, motion.point_inliers, &matches.points);
    appendMatches(direct.lines, motion, motion.line_inliers, &matches.lines);
  }
  const MotionEstimate motion = estimate(matches, T_curr_reference, *reference_, curr);
  if (motion.ok()) {
    measurement->motion = motion;
  } else {
    measurement->sights.points.clear();
    measurement->sights.lines.clear();
  }
}

/// Only a prediction from a velocity can tell the camera's motion from that of what it sees.
MotionEstimate StereoOdometry::Impl::estimate(const Correspondences& matches,
                                              const Eigen::Isometry3d& T_curr_prev,
                                              const StereoFrame& prev,
                                              const StereoFrame& curr) const {
  const double dt_s = seconds(curr.stamp_ns - prev.stamp_ns);
  return pose_.velocity()
             ? estimateCameraMotion(matches, camera_, T_curr_prev, dt_s, parameters_.motion)
             : estimateMotion(matches, camera_, T_curr_prev, parameters_.motion);
}

TrackingReason StereoOdometry::Impl::reasonOf(const MotionEstimate& motion, double dt_s) const {
  if (!motion.ok()) return trackingReason(motion.status);
  const Vector6d velocity = velocityOfMotion(motion.T_curr_prev.inverse(), dt_s);
  const bool too_fast =
      velocity.head<3>().norm() > parameters_.tracking.max_speed_m_s ||
      velocity.tail<3>().norm() * 180.0 / M_PI > parameters_.tracking.max_turn_rate_deg_s;
  return too_fast ? TrackingReason::kTooFast : TrackingReason::kNone;
}

MotionPrediction StereoOdometry::Impl::predict(double dt_s) const {
  const std::optional<CameraVelocity>& velocity = pose_.velocity();
  if (!velocity) {
    return {Eigen::Isometry3d::Identity(), parameters_.matching.search_radius_without_velocity_px};
  }
  const double widening = std::clamp(dt_s / velocity->measured_over_s, 1.0, kMaxWidening);
  return {motionAtVelocity(velocity->value, dt_s).inverse(),
          widening * parameters_.matching.search_radius_px};
}

void StereoOdometry::Impl::integrate(const Measurement& measurement, std::int64_t stamp_ns,
                                     double dt_s) {
  if (measurement.reason == TrackingReason::kNone) {
    const double since_reference_s = seconds(stamp_ns - reference_->stamp_ns);
    pose_.addMeasurement(stepOf(measurement), since_reference_s, stamp_ns);
    output_.followMeasured(pose_, dt_s, parameters_.tracking.standstill_hold);
    state_ = TrackingState::kOk;
  } else if (measurement.reason == TrackingReason::kFirstFrame) {
    output_.followUnknown(pose_, dt_s);
    state_ = TrackingState::kInitializing;
  } else {
    integratePrediction(stamp_ns, dt_s);
  }
}

/// After a gap the pose is kept, however long a prediction may last.
void StereoOdometry::Impl::integratePrediction(std::int64_t stamp_ns, double dt_s) {
  const TrackingParameters& tracking = parameters_.tracking;
  const double max_s = dt_s > tracking.max_frame_gap_s ? 0.0 : tracking.max_prediction_s;
  if (pose_.addPrediction(dt_s, stamp_ns, max_s)) {
    output_.followPredicted(pose_, dt_s);
    state_ = TrackingState::kDegraded;
  } else {
    output_.followUnknown(pose_, dt_s);
    state_ = TrackingState::kLost;
  }
}

/// The pose in odom follows that in the map, but goes no further from the measured motion than the
/// errors of a motion from frame to frame explain, its noise and that of the calibration: a larger
/// correction by the window is spread over frames.
MotionStep StereoOdometry::Impl::stepOf(const Measurement& measurement) const {
  MotionStep step;
  step.T_reference_camera = step.T_measured = measurement.motion.T_curr_prev.inverse();
  step.covariance = measurement.motion.covariance;
  step.lasting = kLastingDirect;
  if (!map_) return step;
  Matrix6d limit = measurement.direct.ok() ? measurement.direct.covariance : step.covariance;
  limit.diagonal().head<3>().array() +=
      std::pow(PoseIntegrator::kScaleError, 2) * step.T_measured.translation().squaredNorm();
  const Eigen::Isometry3d T_odom_camera = T_odom_map_ * map_->T_map_reference() * step.T_measured;
  step.T_reference_camera =
      limitedStep(step.T_measured, pose_.T_odom_reference().inverse() * T_odom_camera, limit,
                  kMaxCorrectionSigmas);
  step.lasting = kLastingOfNew * map_->shareOfNew();
  return step;
}

/// A frame without a measurement does not replace the reference at once: the next one may match it
/// again.
bool StereoOdometry::Impl::shouldBecomeReference(const StereoFrame& curr,
                                                 const Measurement& measurement) const {
  if (!reference_ || measurement.reason == TrackingReason::kNone ||
      measurement.reason == TrackingReason::kFrameGap) {
    return true;
  }
  const bool outlived =
      seconds(curr.stamp_ns - reference_->stamp_ns) > parameters_.tracking.max_prediction_s;
  return outlived &&
         static_cast<int>(curr.points.size() + curr.lines.size()) >= parameters_.motion.min_matches;
}

void StereoOdometry::Impl::refineCalibration(const StereoFrame& curr,
                                             const Measurement& measurement) {
  if (!parameters_.matching.refine_subpixel)
    return;  // whole pixels say nothing about small displacements
  std::vector<CalibrationRefinement::RowSample> rows;
  rows.reserve(curr.points.size());
  for (const StereoPoint& point : curr.points) {
    const Eigen::Vector2f& left_px = curr.features.points_left[point.left].pixel;
    rows.push_back(
        {point.right_px.cast<double>(), static_cast<double>(point.right_px.y() - left_px.y())});
  }
  refinement_.addRows(rows, parameters_.motion.point_noise_px);
  if (!measurement.direct.ok()) return;
  refinement_.addMotion(measurement.correspondences, measurement.direct, parameters_.motion);
}

void StereoOdometry::Impl::takeReference(StereoFrame curr, const FrameContext& context,
                                         const Measurement& measurement) {
  before_reference_.reset();
  const bool measured = measurement.reason == TrackingReason::kNone;
  if (measured && parameters_.motion.fuse_rotation) {
    before_reference_ = EarlierFrame{std::move(*reference_), measurement.motion.T_curr_prev};
  }
  if (!measured) {
    startNewMap();  // how the camera came here from the old one is not known
  } else if (map_) {
    map_->add(curr, context, measurement.sights, measurement.motion, candidatesOf(measurement));
  }
  if (!measured && state_ != TrackingState::kDegraded) pose_.forgetVelocity();
  reference_ = std::move(curr);
  pose_.takeReference();
}

LandmarkCandidates StereoOdometry::Impl::candidatesOf(const Measurement& measurement) {
  LandmarkCandidates candidates;
  if (!measurement.direct.ok()) return candidates;
  const CircularMatches& matches = measurement.matches;
  for (std::size_t i = 0; i < matches.points.size(); ++i) {
    if (measurement.direct.point_inliers[i]) candidates.points.push_back(matches.points[i].second);
  }
  for (std::size_t i = 0; i < matches.lines.size(); ++i) {
    if (measurement.direct.line_inliers[i]) candidates.lines.push_back(matches.lines[i].second);
  }
  return candidates;
}

/// The solution is awaited by the next frame, whenever that comes: the same input gives the same
/// output.
void StereoOdometry::Impl::startWindow() {
  if (!map_) return;
  std::optional<BundleProblem> problem = map_->takeProblem();
  if (!problem) return;
  const auto launch = parameters_.tracking.threads > 1 ? std::launch::async : std::launch::deferred;
  window_ = std::async(launch, [camera = camera_, motion = parameters_.motion,
                                max_iterations = parameters_.window.max_iterations,
                                bundle = std::move(*problem)]() mutable {
    const bool solved = adjustBundle(camera, motion, max_iterations, &bundle);
    return solved ? std::make_optional(std::move(bundle)) : std::nullopt;
  });
}

void StereoOdometry::Impl::finishWindow() {
  if (!window_.valid()) return;
  const std::optional<BundleProblem> solved = window_.get();
  if (solved && map_) map_->adopt(*solved);
}

void StereoOdometry::Impl::reportPose(FrameResult* result) const {
  result->state = state_;
  result->T_odom_camera = output_.T_odom_camera();
  result->pose_covariance = output_.covariance(pose_);
  result->twist = output_.holds() ? Vector6d::Zero() : pose_.twist();
  result->twist_covariance = pose_.twistCovariance();
}

FrameResult StereoOdometry::Impl::dropped(TrackingReason reason, FrameResult result) const {
  result.reason = reason;
  reportPose(&result);
  return result;
}

/// Before the pose is integrated a frame has only been looked at, and the next one can be matched
/// with the same reference; after that, what was to be learnt from it may be half done.
void StereoOdometry::Impl::giveUp(const char* error, double dt_s, FrameResult* result) {
  const bool integrated = last_stamp_ns_ == result->stamp_ns;
  if (integrated) {
    startNewReference();
    state_ = TrackingState::kDegraded;
  } else if (last_stamp_ns_) {
    integratePrediction(result->stamp_ns, dt_s);
  }
  last_stamp_ns_ = result->stamp_ns;
  result->reason = TrackingReason::kException;
  result->error = error;
  reportPose(result);
}

void StereoOdometry::Impl::report(const StereoFrame& curr, const Measurement& measurement,
                                  FrameResult* result) const {
  result->reason = measurement.reason;
  result->rms_px = measurement.motion.rms_px;
  FrameCounts counts = countFeatures(curr);
  counts.point_matches = static_cast<int>(measurement.matches.points.size());
  counts.line_matches = static_cast<int>(measurement.matches.lines.size());
  counts.point_inliers = measurement.direct.num_point_inliers;
  counts.line_inliers = measurement.direct.num_line_inliers;
  counts.iterations = measurement.motion.iterations;
  if (map_) {
    const MapSights& sights = measurement.sights;
    const auto count = [](const std::vector<bool>& inliers, std::size_t size) {
      const auto end = inliers.begin() + static_cast<std::ptrdiff_t>(size);
      return static_cast<int>(std::count(inliers.begin(), end, true));
    };
    counts.map_points = static_cast<int>(map_->numPoints());
    counts.map_lines = static_cast<int>(map_->numLines());
    counts.map_point_inliers = count(measurement.motion.point_inliers, sights.points.size());
    counts.map_line_inliers = count(measurement.motion.line_inliers, sights.lines.size());
    counts.keyframes = static_cast<int>(map_->numKeyframes());
  }
  result->counts = counts;
  observeFeatures(curr, measurement.matches, measurement.direct, result);
}

void StereoOdometry::Impl::reset(const Eigen::Isometry3d& T_odom_camera) {
  last_stamp_ns_.reset();
  refinement_ = CalibrationRefinement(camera_);
  pose_.reset(T_odom_camera);
  output_.reset(T_odom_camera);
  state_ = TrackingState::kInitializing;
  startNewReference();
}

void StereoOdometry::Impl::setCamera(const StereoCamera& camera) {
  camera.validate();
  camera_ = camera;
  refinement_ = CalibrationRefinement(camera);
  startNewReference();
}

void StereoOdometry::Impl::setParameters(const Parameters& parameters) {
  const ParameterTexts changed = changedParameters(parameters_, checked(parameters));
  parameters_ = parameters;
  threads_ = std::make_unique<ThreadPool>(parameters.tracking.threads);
  detector_ = StereoFeatureDetector(parameters.points, parameters.lines);
  const auto is_of_map = [](const auto& parameter) {
    return parameter.first.rfind("window/", 0) == 0 || parameter.first.rfind("local_map/", 0) == 0;
  };
  if (std::none_of(changed.begin(), changed.end(), is_of_map)) return;
  startNewMap();
  T_odom_map_ = pose_.T_odom_reference();
}

std::string StereoOdometry::Impl::saveState() {
  finishWindow();
  StateWriter writer;
  visitState(&writer);
  return writer.take();
}

void StereoOdometry::Impl::restoreState(const std::string& bytes) {
  reset(Eigen::Isometry3d::Identity());
  try {
    StateReader reader(bytes);
    visitState(&reader);
    reader.requireEnd();
  } catch (...) {
    reset(Eigen::Isometry3d::Identity());
    throw;
  }
}

/// The camera, the parameters and what follows from them alone are not in it, nor is the window: it
/// is solved before.
template <typename Archive>
void StereoOdometry::Impl::visitState(Archive* archive) {
  auto& [camera, parameters, threads, detector, refinement, state, reference, before_reference, map,
         T_odom_map, window, pose, output, last_stamp_ns] = *this;
  static_cast<void>(std::tie(camera, threads, detector, window));
  archive->visit(refinement);
  archive->visit(state);
  archive->visit(reference);
  archive->visit(before_reference);
  bool has_map = map.has_value();
  archive->visit(has_map);
  if (has_map && !map) map.emplace(parameters.window, parameters.local_map);
  if (!has_map) map.reset();
  if (map) archive->visit(*map);
  archive->visit(T_odom_map);
  archive->visit(pose);
  archive->visit(output);
  archive->visit(last_stamp_ns);
}

void StereoOdometry::Impl::startNewReference() {
  reference_.reset();
  before_reference_.reset();
  startNewMap();
}

void StereoOdometry::Impl::startNewMap() {
  window_ = {};
  map_.reset();
  if (parameters_.window.size > 0) map_.emplace(parameters_.window, parameters_.local_map);
  T_odom_map_ = pose_.T_odom_camera();
}

StereoOdometry::StereoOdometry(const StereoCamera& camera, const Parameters& parameters)
    : impl_(std::make_unique<Impl>(camera, parameters)) {}
StereoOdometry::~StereoOdometry() = default;
StereoOdometry::StereoOdometry(StereoOdometry&&) noexcept = default;
StereoOdometry& StereoOdometry::operator=(StereoOdometry&&) noexcept = default;

FrameResult StereoOdometry::process(const StereoImages& images) { return impl_->process(images); }
void StereoOdometry::reset(const Eigen::Isometry3d& T_odom_camera) { impl_->reset(T_odom_camera); }
void StereoOdometry::setCamera(const StereoCamera& camera) { impl_->setCamera(camera); }
void StereoOdometry::setParameters(const Parameters& parameters) {
  impl_->setParameters(parameters);
}
std::string StereoOdometry::saveState() { return impl_->saveState(); }
void StereoOdometry::restoreState(const std::string& bytes) { impl_->restoreState(bytes); }
const StereoCamera& StereoOdometry::camera() const { return impl_->camera(); }
const Parameters& StereoOdometry::parameters() const { return impl_->parameters(); }
const RightImageCorrection& StereoOdometry::correction() const { return impl_->correction(); }

}  // namespace point_line_odometry
