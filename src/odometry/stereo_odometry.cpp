#include "point_line_odometry/stereo_odometry.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

#include "odometry/correspondences.h"
#include "odometry/parameter_checker.h"
#include "odometry/stage_timer.h"
#include "odometry/uncertainty.h"

namespace point_line_odometry {
namespace {

constexpr double kMaxWidening = 4.0;  // of the search radius after missing frames

double seconds(std::int64_t ns) { return 1e-9 * static_cast<double>(ns); }

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

StereoOdometry::StereoOdometry(const StereoCamera& camera, const Parameters& parameters)
    : camera_((camera.validate(), camera)),
      parameters_(checked(parameters)),
      threads_(std::make_unique<ThreadPool>(parameters.tracking.threads)),
      detector_(parameters.points, parameters.lines),
      refinement_(camera) {}

FrameResult StereoOdometry::process(const StereoImages& images) {
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

  StereoFrame curr = makeFrame(images, &result.times);
  const bool gap = reference_ && dt_s > parameters_.tracking.max_frame_gap_s;
  Measurement measurement;
  measurement.reason = gap ? TrackingReason::kFrameGap : TrackingReason::kFirstFrame;
  if (reference_ && !gap) measurement = measure(curr, images, &result.times);
  report(curr, measurement, &result);
  if (parameters_.tracking.refine_calibration) {
    const StageTimer timer(&result.times, Stage::kRefine);
    refineCalibration(curr, measurement);
  }

  integrate(measurement, curr.stamp_ns, dt_s);
  last_stamp_ns_ = curr.stamp_ns;
  if (shouldBecomeReference(curr, measurement)) takeReference(std::move(curr), measurement);
  reportPose(&result);
  result.times.total_ms = StageTimer::elapsedMs(begin);
  return result;
}

StereoFrame StereoOdometry::makeFrame(const StereoImages& images, StageTimes* times) {
  StereoFrame frame;
  frame.stamp_ns = images.stamp_ns;
  {
    const StageTimer timer(times, Stage::kDetect);
    images.left.copyTo(frame.left_image);
    frame.features = detector_.detect(images, threads_.get());
  }
  StereoMatches matches;
  {
    const StageTimer timer(times, Stage::kMatchStereo);
    matches = matchStereo(frame.features, parameters_.matching, threads_.get());
  }
  const StageTimer timer(times, Stage::kTriangulate);
  triangulateMatches({matches, images, camera_, refinement_.correction(), parameters_},
                     threads_.get(), &frame);
  return frame;
}

/// The estimate over two frames needs nothing of the direct one: they are made side by side.
StereoOdometry::Measurement StereoOdometry::measure(const StereoFrame& curr,
                                                    const StereoImages& images,
                                                    StageTimes* times) const {
  Measurement measurement;
  const int few = parameters_.motion.min_matches;
  if (static_cast<int>(curr.points.size() + curr.lines.size()) < few) {
    measurement.reason = TrackingReason::kTooFewFeatures;
    return measurement;
  }
  const double dt_s = seconds(curr.stamp_ns - reference_->stamp_ns);
  const MotionPrediction prediction = predict(dt_s);
  MotionEstimate over_two;
  threads_->run(before_reference_ ? 2 : 1, [&](int task) {
    if (task == 0) {
      measurement = measureSince(*reference_, curr, images, prediction,
                                 {times, Stage::kMatchCircular, Stage::kEstimate});
    } else {
      const MotionPrediction since_two_frames{
          prediction.T_curr_prev * before_reference_->T_reference_before, prediction.radius_px};
      over_two = measureSince(before_reference_->frame, curr, images, since_two_frames,
                              {times, Stage::kTwoFrames, Stage::kTwoFrames})
                     .motion;
    }
  });
  if (measurement.motion.ok() && over_two.ok()) {
    const StageTimer timer(times, Stage::kFuse);
    measurement.motion = fuseRotation(measurement.motion, over_two.T_curr_prev,
                                      before_reference_->T_reference_before,
                                      measurement.correspondences, camera_, parameters_.motion);
  }
  measurement.reason = reasonOf(measurement.motion, dt_s);
  return measurement;
}

StereoOdometry::Measurement StereoOdometry::measureSince(const StereoFrame& earlier,
                                                         const StereoFrame& curr,
                                                         const StereoImages& images,
                                                         const MotionPrediction& prediction,
                                                         const MeasureTimes& times) const {
  Measurement measurement;
  {
    const StageTimer timer(times.times, times.match);
    measurement.matches = matchCircular(earlier, curr, camera_, prediction, parameters_.matching);
    measurement.correspondences = makeCorrespondences(earlier, curr, images, measurement.matches,
                                                      refinement_.correction(), parameters_);
  }
  const StageTimer timer(times.times, times.estimate);
  measurement.motion = estimateMotion(measurement.correspondences, camera_, prediction.T_curr_prev,
                                      parameters_.motion);
  return measurement;
}

TrackingReason StereoOdometry::reasonOf(const MotionEstimate& motion, double dt_s) const {
  if (!motion.ok()) return trackingReason(motion.status);
  const Vector6d velocity = velocityOfMotion(motion.T_curr_prev.inverse(), dt_s);
  const bool too_fast =
      velocity.head<3>().norm() > parameters_.tracking.max_speed_m_s ||
      velocity.tail<3>().norm() * 180.0 / M_PI > parameters_.tracking.max_turn_rate_deg_s;
  return too_fast ? TrackingReason::kTooFast : TrackingReason::kNone;
}

MotionPrediction StereoOdometry::predict(double dt_s) const {
  const std::optional<CameraVelocity>& velocity = pose_.velocity();
  if (!velocity) {
    return {Eigen::Isometry3d::Identity(), parameters_.matching.search_radius_without_velocity_px};
  }
  const double widening = std::clamp(dt_s / velocity->measured_over_s, 1.0, kMaxWidening);
  return {motionAtVelocity(velocity->value, dt_s).inverse(),
          widening * parameters_.matching.search_radius_px};
}

void StereoOdometry::integrate(const Measurement& measurement, std::int64_t stamp_ns, double dt_s) {
  if (measurement.reason == TrackingReason::kNone) {
    const double since_reference_s = seconds(stamp_ns - reference_->stamp_ns);
    pose_.addMeasurement(measurement.motion.T_curr_prev.inverse(), measurement.motion.covariance,
                         since_reference_s, stamp_ns);
    state_ = TrackingState::kOk;
  } else if (measurement.reason == TrackingReason::kFirstFrame) {
    state_ = TrackingState::kInitializing;
  } else {
    const bool moves = pose_.addPrediction(dt_s, stamp_ns, parameters_.tracking.max_prediction_s);
    state_ = moves ? TrackingState::kDegraded : TrackingState::kLost;
  }
}

/// A frame without a measurement does not replace the reference at once: the next one may match it
/// again.
bool StereoOdometry::shouldBecomeReference(const StereoFrame& curr,
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

void StereoOdometry::refineCalibration(const StereoFrame& curr, const Measurement& measurement) {
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
  if (measurement.reason != TrackingReason::kNone) return;
  refinement_.addMotion(measurement.correspondences, measurement.motion, parameters_.motion);
}

void StereoOdometry::takeReference(StereoFrame curr, const Measurement& measurement) {
  before_reference_.reset();
  const bool measured = measurement.reason == TrackingReason::kNone;
  if (measured && parameters_.motion.fuse_rotation) {
    before_reference_ = EarlierFrame{std::move(*reference_), measurement.motion.T_curr_prev};
  }
  if (!measured && state_ != TrackingState::kDegraded) pose_.forgetVelocity();
  reference_ = std::move(curr);
  pose_.takeReference();
}

void StereoOdometry::reportPose(FrameResult* result) const {
  result->state = state_;
  result->T_odom_camera = pose_.T_odom_camera();
  result->pose_covariance = pose_.covariance();
  result->twist = pose_.twist();
  result->twist_covariance = pose_.twistCovariance();
}

FrameResult StereoOdometry::dropped(TrackingReason reason, FrameResult result) const {
  result.reason = reason;
  reportPose(&result);
  return result;
}

void StereoOdometry::report(const StereoFrame& curr, const Measurement& measurement,
                            FrameResult* result) const {
  result->reason = measurement.reason;
  result->rms_px = measurement.motion.rms_px;
  result->counts = countFeatures(curr);
  result->counts.point_matches = static_cast<int>(measurement.matches.points.size());
  result->counts.line_matches = static_cast<int>(measurement.matches.lines.size());
  result->counts.point_inliers = measurement.motion.num_point_inliers;
  result->counts.line_inliers = measurement.motion.num_line_inliers;
  result->counts.iterations = measurement.motion.iterations;
  observeFeatures(curr, measurement.matches, measurement.motion, result);
}

void StereoOdometry::reset(const Eigen::Isometry3d& T_odom_camera) {
  reference_.reset();
  before_reference_.reset();
  last_stamp_ns_.reset();
  refinement_ = CalibrationRefinement(camera_);
  pose_.reset(T_odom_camera);
  state_ = TrackingState::kInitializing;
}

void StereoOdometry::setCamera(const StereoCamera& camera) {
  camera.validate();
  camera_ = camera;
  refinement_ = CalibrationRefinement(camera);
  startNewReference();
}

void StereoOdometry::setParameters(const Parameters& parameters) {
  parameters_ = checked(parameters);
  threads_ = std::make_unique<ThreadPool>(parameters.tracking.threads);
  detector_ = StereoFeatureDetector(parameters.points, parameters.lines);
  startNewReference();
}

void StereoOdometry::startNewReference() {
  reference_.reset();
  before_reference_.reset();
}

}  // namespace point_line_odometry
