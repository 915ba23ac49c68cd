#include "point_line_odometry/stereo_odometry.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <future>
#include <iterator>
#include <optional>
#include <stdexcept>
#include <utility>

#include "common/join.h"
#include "map/bundle_adjustment.h"
#include "odometry/correspondences.h"
#include "odometry/image_reduction.h"
#include "odometry/motion_measurement.h"
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

// How far a frame's motion may be changed by what the map has corrected, in standard deviations.
constexpr double kMaxCorrectionSigmas = 3.0;

// Errors of successive motions are alike, as they come from the same features: so many times a
// motion's covariance is handed on to the next poses, times the root of the share of what is seen
// that is new: all of it from frame to frame, a part of the landmarks of a map. Measured in the
// built-in worlds (NEES).
constexpr double kLasting = 7.0;

// How far from where it was expected the camera may be found again, in standard deviations.
constexpr double kMaxReachSigmas = 6.0;

// While the way is measured, so often the camera is looked for in the map of before as well.
constexpr double kRetry_s = 0.5;

// The share of new features where no map counts them: between a flight's 6 % and that of a car
// whose frames are 4 m apart, 65 %.
constexpr double kShareOfNewWithoutMap = 0.35;

Parameters checked(const Parameters& parameters) {
  const std::vector<std::string> errors = checkParameters(parameters);
  if (!errors.empty()) throw std::invalid_argument("parameters: " + join(errors, "; "));
  return parameters;
}

/// Whether the frame before the reference will be needed.
bool fusesRotation(const Parameters& parameters) {
  const std::string& when = parameters.motion.fuse_rotation;
  return when == "always" || (when == "without_landmarks" && parameters.window.size == 0);
}

bool fits(const cv::Mat& image, const StereoCamera& camera) {
  return image.type() == CV_8UC1 && image.cols == camera.width && image.rows == camera.height;
}

/// What was tracked until the way from there was lost.
struct LostTrack {
  FrameHistory history;  // with a map
  Eigen::Isometry3d T_odom_map = Eigen::Isometry3d::Identity();
  Eigen::Isometry3d T_odom_reference = Eigen::Isometry3d::Identity();
  Matrix6d reference_covariance = Matrix6d::Zero();
  std::int64_t tried_ns = 0;  // stamp of the last frame that was looked for in it
};

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
  const StereoCamera& camera() const { return input_camera_; }
  const Parameters& parameters() const { return parameters_; }
  LineDetectorKind lineDetector() const { return detector_.lineDetector(); }
  const RightImageCorrection& correction() const { return refinement_.correction(); }

 private:
  void track(const StereoImages& images, double dt_s, FrameResult* result);
  MotionMeasurement measure(const StereoFrame& curr, const FrameContext& context, double dt_s,
                            StageTimes* times);
  std::optional<MotionMeasurement> findLostTrack(const StereoFrame& curr,
                                                 const FrameContext& context, double dt_s,
                                                 StageTimes* times);
  bool isWithinReach(const Eigen::Isometry3d& T_odom_reference, const MotionEstimate& motion,
                     std::int64_t stamp_ns, double dt_s) const;
  StereoFrame makeFrame(FrameContext* context, StageTimes* times);
  void addCoarserPoints(FrameContext* context, StereoFrame* frame);
  void integrate(const MotionMeasurement& measurement, std::int64_t stamp_ns, double dt_s);
  void integratePrediction(std::int64_t stamp_ns, double dt_s);
  MotionStep stepOf(const MotionMeasurement& measurement) const;
  bool shouldBecomeReference(const StereoFrame& curr, const MotionMeasurement& measurement) const;
  void keepLostTrack();
  void takeReference(StereoFrame curr, const FrameContext& context,
                     const MotionMeasurement& measurement);
  static LandmarkCandidates candidatesOf(const MotionMeasurement& measurement,
                                         const StereoFrame& curr);
  void startWindow();
  void finishWindow();
  bool isFoundAgain(const MotionMeasurement& measurement) const;
  void report(const StereoFrame& curr, const MotionMeasurement& measurement,
              FrameResult* result) const;
  void reportPose(FrameResult* result) const;
  FrameResult dropped(TrackingReason reason, FrameResult result) const;
  void giveUp(const char* error, double dt_s, FrameResult* result);
  void refineRows(const StereoFrame& curr);
  void refineDisparities(const MotionMeasurement& measurement);
  void useCamera();
  void startNewReference();
  void startNewMap();
  template <typename Archive>
  void visitState(Archive* archive);

  StereoCamera input_camera_;
  Parameters parameters_;
  ImageReduction reduction_;
  std::unique_ptr<ThreadPool> threads_;
  StereoFeatureDetector detector_;
  CalibrationRefinement refinement_;

  // State.
  TrackingState state_ = TrackingState::kInitializing;
  int failed_windows_ = 0;  // that no frame has reported yet
  FrameHistory history_;
  std::optional<LostTrack> lost_;
  NoiseScale noise_;
  Eigen::Isometry3d T_odom_map_ = Eigen::Isometry3d::Identity();
  std::future<std::optional<BundleProblem>> window_;  // solved beside the next frame's first stages
  PoseIntegrator pose_;
  SteadyPose output_;
  std::optional<std::int64_t> last_stamp_ns_;  // of the last accepted frame
};

StereoOdometry::Impl::Impl(const StereoCamera& camera, const Parameters& parameters)
    : input_camera_((camera.validate(), camera)),
      parameters_(checked(parameters)),
      reduction_(camera, parameters.tracking),
      threads_(std::make_unique<ThreadPool>(parameters.tracking.threads)),
      detector_(parameters.points, parameters.lines),
      refinement_(reduction_.camera()) {
  startNewReference();
}

FrameResult StereoOdometry::Impl::process(const StereoImages& images) {
  const auto begin = StageTimer::Clock::now();
  FrameResult result;
  result.stamp_ns = images.stamp_ns;
  if (!fits(images.left, input_camera_) || !fits(images.right, input_camera_)) {
    return dropped(TrackingReason::kWrongImages, std::move(result));
  }
  if (last_stamp_ns_ && images.stamp_ns <= *last_stamp_ns_) {
    return dropped(TrackingReason::kStampNotNewer, std::move(result));
  }
  const double dt_s = last_stamp_ns_ ? toSeconds(images.stamp_ns - *last_stamp_ns_) : 0.0;
  try {
    track(reduction_.reduce(images), dt_s, &result);
    reduction_.toInputPixels(&result);
  } catch (const std::exception& error) {
    giveUp(error.what(), dt_s, &result);
  }
  result.times.total_ms = StageTimer::elapsedMs(begin);
  return result;
}

void StereoOdometry::Impl::track(const StereoImages& images, double dt_s, FrameResult* result) {
  const RightImageCorrection correction = refinement_.correction();
  FrameContext context{images, reduction_.camera(), correction, parameters_, noise_};
  StereoFrame curr = makeFrame(&context, &result->times);
  {
    const StageTimer timer(&result->times, Stage::kWindow);
    finishWindow();
  }
  const MotionMeasurement measurement = measure(curr, context, dt_s, &result->times);
  report(curr, measurement, result);
  result->counts.failed_windows = std::exchange(failed_windows_, 0);
  integrate(measurement, curr.stamp_ns, dt_s);
  last_stamp_ns_ = curr.stamp_ns;
  reportPose(result);

  // What the next frames will need.
  if (parameters_.motion.adapt_noise && history_.map &&
      measurement.reason == TrackingReason::kNone) {
    noise_.learn(measurement.motion.point_residuals, measurement.motion.line_residuals);
  }
  // Whole pixels say nothing about small displacements.
  const bool refines =
      parameters_.tracking.refine_calibration && parameters_.matching.refine_subpixel;
  if (refines) {
    const StageTimer timer(&result->times, Stage::kRefine);
    refineRows(curr);
  }
  if (shouldBecomeReference(curr, measurement)) {
    const StageTimer timer(&result->times, Stage::kLearn);
    takeReference(std::move(curr), context, measurement);
    startWindow();
  }
  if (refines && measurement.direct.ok()) {
    const StageTimer timer(&result->times, Stage::kRefine);
    refineDisparities(measurement);
  }
}

/// Against the last frames and the map, after a gap against the map alone; then, while there is a
/// lost track, against that.
MotionMeasurement StereoOdometry::Impl::measure(const StereoFrame& curr,
                                                const FrameContext& context, double dt_s,
                                                StageTimes* times) {
  MotionMeasurement measurement;
  measurement.reason = TrackingReason::kFirstFrame;
  if (history_.reference) {
    const MotionMeter meter(history_, pose_.velocity(), context, threads_.get(), times);
    const bool gap = dt_s > parameters_.tracking.max_frame_gap_s;
    measurement = gap ? meter.relocalize(curr) : meter.measure(curr);
    const bool refused =
        measurement.relocalized
            ? !isWithinReach(pose_.T_odom_reference(), measurement.motion, curr.stamp_ns, dt_s)
            : gap;
    if (refused) {
      measurement = MotionMeasurement();
      measurement.reason = gap ? TrackingReason::kFrameGap : TrackingReason::kTooFewInliers;
    }
  }
  if (measurement.relocalized || !lost_) return measurement;
  const bool measured = measurement.reason == TrackingReason::kNone;
  if (measured && toSeconds(curr.stamp_ns - lost_->tried_ns) < kRetry_s) return measurement;
  return findLostTrack(curr, context, dt_s, times).value_or(measurement);
}

/// Whether the camera can have come to where it was found from its last pose.
bool StereoOdometry::Impl::isWithinReach(const Eigen::Isometry3d& T_odom_reference,
                                         const MotionEstimate& motion, std::int64_t stamp_ns,
                                         double dt_s) const {
  PoseIntegrator expected = pose_;
  expected.addPrediction(dt_s, stamp_ns, parameters_.tracking.max_prediction_s);
  const Vector6d way =
      poseDifference(expected.T_odom_camera(), T_odom_reference * motion.T_curr_prev.inverse());
  const double squared = way.dot(expected.covariance().ldlt().solve(way));
  return squared <= kMaxReachSigmas * kMaxReachSigmas;
}

/// Returns to the lost track if the frame shows a place of its map.
std::optional<MotionMeasurement> StereoOdometry::Impl::findLostTrack(const StereoFrame& curr,
                                                                     const FrameContext& context,
                                                                     double dt_s,
                                                                     StageTimes* times) {
  const double lost_s = toSeconds(curr.stamp_ns - lost_->history.reference->stamp_ns);
  if (lost_s > parameters_.tracking.relocalization_s) {
    lost_.reset();
    return std::nullopt;
  }
  lost_->tried_ns = curr.stamp_ns;
  const std::optional<CameraVelocity> unknown;
  const MotionMeter meter(lost_->history, unknown, context, threads_.get(), times);
  MotionMeasurement found = meter.relocalize(curr);
  if (!found.relocalized ||
      !isWithinReach(lost_->T_odom_reference, found.motion, curr.stamp_ns, dt_s)) {
    return std::nullopt;
  }
  history_ = std::move(lost_->history);
  T_odom_map_ = lost_->T_odom_map;
  pose_.returnTo(lost_->T_odom_reference, lost_->reference_covariance);
  lost_.reset();
  return found;
}

StereoFrame StereoOdometry::Impl::makeFrame(FrameContext* context, StageTimes* times) {
  StereoFrame frame;
  frame.stamp_ns = context->images.stamp_ns;
  {
    const StageTimer timer(times, Stage::kDetect);
    frame.left_image = ImagePyramid(context->images.left.clone());
    frame.features = detector_.detect(context->images, threads_.get());
  }
  StereoMatches matches;
  {
    const StageTimer timer(times, Stage::kMatchStereo);
    matches = matchStereo(frame.features, parameters_.matching, threads_.get());
  }
  {
    const StageTimer timer(times, Stage::kTriangulate);
    triangulateMatches(matches, *context, threads_.get(), &frame);
  }
  if (parameters_.points.enabled && parameters_.points.levels > 1) {
    const StageTimer timer(times, Stage::kDetect);
    addCoarserPoints(context, &frame);
  }
  return frame;
}

/// Points of coarser levels where the frame is short of points, and the levels themselves, too,
/// where points of the reference are looked for in them.
void StereoOdometry::Impl::addCoarserPoints(FrameContext* context, StereoFrame* frame) {
  const PointCoverage coverage(*frame, *context);
  const bool poor = coverage.isPoor();
  if (!poor && !(history_.reference && hasCoarserPoints(*history_.reference))) return;
  threads_->run(2, [&](int task) {
    (task == 0 ? context->left : context->right).addLevels(parameters_.points);
  });
  std::copy(context->left.levels.begin() + 1, context->left.levels.end(),
            std::back_inserter(frame->left_image.levels));
  if (!poor) return;
  const DetectedFeatures coarser =
      detector_.detectCoarserPoints(context->left, context->right, threads_.get());
  ::point_line_odometry::addCoarserPoints(coarser, coverage, *context, threads_.get(), frame);
}

void StereoOdometry::Impl::integrate(const MotionMeasurement& measurement, std::int64_t stamp_ns,
                                     double dt_s) {
  if (measurement.reason == TrackingReason::kNone) {
    const double since_reference_s = toSeconds(stamp_ns - history_.reference->stamp_ns);
    pose_.addMeasurement(stepOf(measurement), since_reference_s, stamp_ns);
    if (since_reference_s > std::max(dt_s, parameters_.tracking.max_prediction_s)) {
      pose_.forgetMeasuredVelocity();  // a mean over a time in which nothing was seen
      output_.followUnknown(pose_, dt_s);
    } else {
      output_.followMeasured(pose_, dt_s, parameters_.tracking.standstill_hold);
    }
    state_ = measurement.weak ? TrackingState::kDegraded : TrackingState::kOk;
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
MotionStep StereoOdometry::Impl::stepOf(const MotionMeasurement& measurement) const {
  MotionStep step;
  step.T_reference_camera = step.T_measured = measurement.motion.T_curr_prev.inverse();
  step.covariance = measurement.motion.covariance;
  step.lasting = kLasting;
  if (!history_.map) return step;
  Matrix6d limit = measurement.direct.ok() ? measurement.direct.covariance : step.covariance;
  limit.diagonal().head<3>().array() +=
      std::pow(PoseIntegrator::kScaleError, 2) * step.T_measured.translation().squaredNorm();
  const Eigen::Isometry3d T_odom_camera =
      T_odom_map_ * history_.map->T_map_reference() * step.T_measured;
  step.T_reference_camera =
      limitedStep(step.T_measured, pose_.T_odom_reference().inverse() * T_odom_camera, limit,
                  kMaxCorrectionSigmas);
  const double share_of_new = history_.map->shareOfNew();
  step.lasting *= std::sqrt(share_of_new);
  // Landmarks that the reference brought lie where it saw them, others do not share its error.
  step.reference_covariance = (1.0 - share_of_new) * history_.map->referenceCovariance();
  return step;
}

/// A frame without a measurement does not replace the reference at once: the next one may match it
/// again.
bool StereoOdometry::Impl::shouldBecomeReference(const StereoFrame& curr,
                                                 const MotionMeasurement& measurement) const {
  if (!history_.reference || measurement.reason == TrackingReason::kNone ||
      measurement.reason == TrackingReason::kFrameGap) {
    return true;
  }
  const bool outlived = toSeconds(curr.stamp_ns - history_.reference->stamp_ns) >
                        parameters_.tracking.max_prediction_s;
  return outlived &&
         static_cast<int>(curr.points.size() + curr.lines.size()) >= parameters_.motion.min_matches;
}

void StereoOdometry::Impl::refineRows(const StereoFrame& curr) {
  std::vector<CalibrationRefinement::RowSample> rows;
  rows.reserve(curr.points.size());
  for (const StereoPoint& point : curr.points) {
    const Eigen::Vector2f& left_px = curr.features.points_left[point.left].pixel;
    rows.push_back(
        {point.right_px.cast<double>(), static_cast<double>(point.right_px.y() - left_px.y())});
  }
  refinement_.addRows(rows, parameters_.motion.point_noise_px);
}

void StereoOdometry::Impl::refineDisparities(const MotionMeasurement& measurement) {
  std::optional<double> share_of_new = kShareOfNewWithoutMap;
  if (history_.map) share_of_new = history_.map->shareOfNew();
  if (share_of_new == 1.0) share_of_new.reset();  // the map has just begun
  refinement_.addMotion(measurement.correspondences, measurement.direct, parameters_.motion,
                        share_of_new);
}

void StereoOdometry::Impl::takeReference(StereoFrame curr, const FrameContext& context,
                                         const MotionMeasurement& measurement) {
  history_.before_reference.reset();
  const bool measured = measurement.reason == TrackingReason::kNone;
  if (!measured) keepLostTrack();
  if (measured && fusesRotation(parameters_)) {
    history_.before_reference =
        EarlierFrame{std::move(*history_.reference), measurement.motion.T_curr_prev};
  }
  if (!measured) {
    startNewMap();  // how the camera came here from the old one is not known
  } else if (history_.map) {
    history_.map->add(curr, context, measurement.sights, measurement.motion,
                      candidatesOf(measurement, curr));
  }
  if (!measured && state_ != TrackingState::kDegraded) pose_.forgetVelocity();
  history_.reference = std::move(curr);
  pose_.takeReference();
}

/// How the camera will have come from here is not known: what was tracked so far is kept, to be
/// found again. Of two lost tracks the longer one.
void StereoOdometry::Impl::keepLostTrack() {
  if (!history_.reference || !history_.map || parameters_.tracking.relocalization_s == 0.0) return;
  if (lost_ && lost_->history.map->numKeyframes() > history_.map->numKeyframes()) return;
  lost_ = LostTrack{std::exchange(history_, FrameHistory()), T_odom_map_, pose_.T_odom_reference(),
                    pose_.referenceCovariance(), 0};
}

LandmarkCandidates StereoOdometry::Impl::candidatesOf(const MotionMeasurement& measurement,
                                                      const StereoFrame& curr) {
  LandmarkCandidates candidates;
  if (!measurement.direct.ok()) return candidates;
  const CircularMatches& matches = measurement.matches;
  std::vector<bool> matched(curr.points.size(), false);
  for (std::size_t i = 0; i < matches.points.size(); ++i) {
    const int point = matches.points[i].second;
    matched[point] = true;
    if (measurement.direct.point_inliers[i] && !curr.points[point].far)
      candidates.points.push_back(point);
  }
  for (std::size_t i = 0; i < matched.size(); ++i) {
    if (!matched[i] && !curr.points[i].far)
      candidates.unmatched_points.push_back(static_cast<int>(i));
  }
  for (std::size_t i = 0; i < matches.lines.size(); ++i) {
    if (measurement.direct.line_inliers[i]) candidates.lines.push_back(matches.lines[i].second);
  }
  return candidates;
}

/// The solution is awaited by the next frame, whenever that comes: the same input gives the same
/// output.
void StereoOdometry::Impl::startWindow() {
  if (!history_.map) return;
  std::optional<BundleProblem> problem = history_.map->takeProblem();
  if (!problem) return;
  const auto launch = parameters_.tracking.threads > 1 ? std::launch::async : std::launch::deferred;
  window_ = std::async(launch, [camera = reduction_.camera(), motion = parameters_.motion,
                                max_iterations = parameters_.window.max_iterations,
                                bundle = std::move(*problem)]() mutable {
    const bool solved = adjustBundle(camera, motion, max_iterations, &bundle);
    return solved ? std::make_optional(std::move(bundle)) : std::nullopt;
  });
}

void StereoOdometry::Impl::finishWindow() {
  if (!window_.valid()) return;
  const std::optional<BundleProblem> solved = window_.get();
  failed_windows_ += solved ? 0 : 1;
  if (solved && history_.map) history_.map->adopt(*solved);
}

void StereoOdometry::Impl::reportPose(FrameResult* result) const {
  result->state = state_;
  result->T_odom_camera = output_.T_odom_camera();
  result->T_odom_estimate = pose_.T_odom_camera();
  result->pose_covariance = output_.covariance(pose_);
  result->twist = output_.holds() ? Vector6d::Zero() : pose_.twist();
  result->twist_covariance = pose_.twistCovariance();
  const bool measured = state_ == TrackingState::kOk && pose_.velocity();
  result->twist_over_s = measured ? pose_.velocity()->measured_over_s : 0.0;
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

/// By the landmarks, or by the last frame of before.
bool StereoOdometry::Impl::isFoundAgain(const MotionMeasurement& measurement) const {
  const bool measured = measurement.reason == TrackingReason::kNone;
  return measurement.relocalized || (measured && state_ == TrackingState::kLost &&
                                     history_.reference->stamp_ns < *last_stamp_ns_);
}

void StereoOdometry::Impl::report(const StereoFrame& curr, const MotionMeasurement& measurement,
                                  FrameResult* result) const {
  result->reason = measurement.weak ? TrackingReason::kWeakMotion : measurement.reason;
  result->rms_px = measurement.motion.rms_px;
  result->point_residuals = measurement.motion.point_residuals;
  result->line_residuals = measurement.motion.line_residuals;
  FrameCounts counts = countFeatures(curr);
  counts.point_matches = static_cast<int>(measurement.matches.points.size());
  counts.line_matches = static_cast<int>(measurement.matches.lines.size());
  counts.point_inliers = measurement.direct.num_point_inliers;
  counts.line_inliers = measurement.direct.num_line_inliers;
  counts.iterations = measurement.motion.iterations;
  counts.relocalizations = isFoundAgain(measurement) ? 1 : 0;
  if (history_.map) {
    const MapSights& sights = measurement.sights;
    counts.map_points = static_cast<int>(history_.map->numPoints());
    counts.map_lines = static_cast<int>(history_.map->numLines());
    counts.map_point_inliers = countInliers(measurement.motion.point_inliers, sights.points.size());
    counts.map_line_inliers = countInliers(measurement.motion.line_inliers, sights.lines.size());
    counts.keyframes = static_cast<int>(history_.map->numKeyframes());
  }
  result->counts = counts;
  observeFeatures(curr, measurement.matches, measurement.direct, result);
}

void StereoOdometry::Impl::reset(const Eigen::Isometry3d& T_odom_camera) {
  last_stamp_ns_.reset();
  refinement_ = CalibrationRefinement(reduction_.camera());
  noise_ = NoiseScale();
  pose_.reset(T_odom_camera);
  output_.reset(T_odom_camera);
  state_ = TrackingState::kInitializing;
  startNewReference();
}

void StereoOdometry::Impl::setCamera(const StereoCamera& camera) {
  camera.validate();
  input_camera_ = camera;
  useCamera();
}

/// Of what was estimated before, nothing holds for images of another camera or size.
void StereoOdometry::Impl::useCamera() {
  reduction_ = ImageReduction(input_camera_, parameters_.tracking);
  refinement_ = CalibrationRefinement(reduction_.camera());
  noise_ = NoiseScale();
  startNewReference();
}

void StereoOdometry::Impl::setParameters(const Parameters& parameters) {
  const ParameterTexts changed = changedParameters(parameters_, checked(parameters));
  parameters_ = parameters;
  if (!parameters.motion.adapt_noise || parameters.window.size == 0) noise_ = NoiseScale();
  threads_ = std::make_unique<ThreadPool>(parameters.tracking.threads);
  detector_ = StereoFeatureDetector(parameters.points, parameters.lines);
  if (ImageReduction(input_camera_, parameters.tracking).camera() != reduction_.camera())
    useCamera();
  const auto is_changed = [&](const char* name) {
    return std::any_of(changed.begin(), changed.end(),
                       [&](const auto& parameter) { return parameter.first == name; });
  };
  if (is_changed("points/descriptor")) startNewReference();  // the old ones cannot be compared
  const auto is_of_map = [](const auto& parameter) {
    return parameter.first.rfind("window/", 0) == 0 || parameter.first.rfind("local_map/", 0) == 0;
  };
  if (std::none_of(changed.begin(), changed.end(), is_of_map)) return;
  lost_.reset();
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
  auto& [input_camera, parameters, reduction, threads, detector, refinement, state, failed_windows,
         history, lost, noise, T_odom_map, window, pose, output, last_stamp_ns] = *this;
  static_cast<void>(std::tie(input_camera, parameters, reduction, threads, detector, window));
  archive->visit(refinement);
  archive->visit(state);
  const auto visit_history = [&](FrameHistory* frames) {
    archive->visit(frames->reference);
    archive->visit(frames->before_reference);
    bool has_map = frames->map.has_value();
    archive->visit(has_map);
    if (has_map && !frames->map) frames->map.emplace(parameters_.window, parameters_.local_map);
    if (!has_map) frames->map.reset();
    if (has_map) archive->visit(*frames->map);
  };
  visit_history(&history);
  bool has_lost = lost.has_value();
  archive->visit(has_lost);
  if (has_lost && !lost) lost.emplace();
  if (!has_lost) lost.reset();
  if (has_lost) {
    visit_history(&lost->history);
    archive->visit(lost->T_odom_map);
    archive->visit(lost->T_odom_reference);
    archive->visit(lost->reference_covariance);
    archive->visit(lost->tried_ns);
  }
  archive->visit(noise);
  archive->visit(T_odom_map);
  archive->visit(failed_windows);
  archive->visit(pose);
  archive->visit(output);
  archive->visit(last_stamp_ns);
}

void StereoOdometry::Impl::startNewReference() {
  lost_.reset();
  history_.reference.reset();
  history_.before_reference.reset();
  startNewMap();
}

void StereoOdometry::Impl::startNewMap() {
  window_ = {};
  history_.map.reset();
  if (parameters_.window.size > 0) history_.map.emplace(parameters_.window, parameters_.local_map);
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
LineDetectorKind StereoOdometry::lineDetector() const { return impl_->lineDetector(); }
const RightImageCorrection& StereoOdometry::correction() const { return impl_->correction(); }

}  // namespace point_line_odometry
