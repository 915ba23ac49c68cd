#include "point_line_odometry/stereo_odometry.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <stdexcept>
#include <utility>

#include "odometry/correspondences.h"
#include "odometry/uncertainty.h"

namespace point_line_odometry {
namespace {

constexpr double kMaxWidening = 4.0;  // of the search radius after missing frames

double seconds(std::int64_t ns) { return 1e-9 * static_cast<double>(ns); }

Parameters checked(const Parameters& parameters) {
  std::string text;
  for (const std::string& error : checkParameters(parameters))
    text += (text.empty() ? "" : "; ") + error;
  if (!text.empty()) throw std::invalid_argument("parameters: " + text);
  return parameters;
}

/// Adds the time from its making to its end to a stage.
class StageTimer {
 public:
  StageTimer(StageTimes* times, Stage stage) : ms_(&times->ms[static_cast<std::size_t>(stage)]) {}
  StageTimer(const StageTimer&) = delete;
  StageTimer& operator=(const StageTimer&) = delete;
  ~StageTimer() {
    *ms_ += std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - begin_)
                .count();
  }

 private:
  double* ms_;
  std::chrono::steady_clock::time_point begin_ = std::chrono::steady_clock::now();
};

bool fits(const cv::Mat& image, const StereoCamera& camera) {
  return image.type() == CV_8UC1 && image.cols == camera.width && image.rows == camera.height;
}

TrackingReason reasonOf(MotionStatus status) {
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
      detector_(parameters.points, parameters.lines),
      refinement_(camera) {}

FrameResult StereoOdometry::process(const StereoImages& images) {
  const auto begin = std::chrono::steady_clock::now();
  FrameResult result;
  result.stamp_ns = images.stamp_ns;
  result.T_odom_camera = T_odom_camera_;
  result.pose_covariance = pose_covariance_;
  result.state = state_;
  if (!fits(images.left, camera_) || !fits(images.right, camera_)) {
    result.reason = TrackingReason::kWrongImages;
    return result;
  }
  if (last_stamp_ns_ && images.stamp_ns <= *last_stamp_ns_) {
    result.reason = TrackingReason::kStampNotNewer;
    return result;
  }
  const double dt_s = last_stamp_ns_ ? seconds(images.stamp_ns - *last_stamp_ns_) : 0.0;

  StereoFrame curr = makeFrame(images, &result.times);
  const bool gap = reference_ && dt_s > parameters_.tracking.max_frame_gap_s;
  Measurement measurement;
  measurement.reason = gap ? TrackingReason::kFrameGap : TrackingReason::kFirstFrame;
  if (reference_ && !gap) measurement = measure(curr, &result.times);
  report(curr, measurement, &result);
  if (parameters_.tracking.refine_calibration) refineCalibration(curr, measurement);

  if (measurement.reason == TrackingReason::kNone) {
    integrateMeasurement(measurement, curr);
  } else if (measurement.reason == TrackingReason::kFirstFrame) {
    state_ = TrackingState::kInitializing;
  } else {
    integratePrediction(curr, dt_s);
  }
  const bool outlived = reference_ && seconds(curr.stamp_ns - reference_->stamp_ns) >
                                          parameters_.tracking.max_prediction_s;
  const bool matchable =
      static_cast<int>(curr.points.size() + curr.lines.size()) >= parameters_.motion.min_matches;
  last_stamp_ns_ = curr.stamp_ns;
  if (measurement.reason == TrackingReason::kNone || !reference_ || gap ||
      (outlived && matchable)) {
    takeReference(std::move(curr), measurement);
  }

  result.state = state_;
  result.T_odom_camera = T_odom_camera_;
  result.pose_covariance = pose_covariance_;
  if (velocity_) {
    result.twist = velocity_->value;
    result.twist_covariance = velocity_->covariance;
  }
  result.times.total_ms =
      std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - begin).count();
  return result;
}

StereoFrame StereoOdometry::makeFrame(const StereoImages& images, StageTimes* times) {
  StereoFrame frame;
  frame.stamp_ns = images.stamp_ns;
  {
    const StageTimer timer(times, Stage::kDetect);
    frame.images = {images.left.clone(), images.right.clone(), images.stamp_ns};
    frame.features = detector_.detect(images);
  }
  StereoMatches matches;
  {
    const StageTimer timer(times, Stage::kMatchStereo);
    matches = matchStereo(frame.features, parameters_.matching);
  }
  const StageTimer timer(times, Stage::kTriangulate);
  triangulateMatches(matches, camera_, refinement_.correction(), parameters_, &frame);
  return frame;
}

StereoOdometry::Measurement StereoOdometry::measure(const StereoFrame& curr,
                                                    StageTimes* times) const {
  Measurement measurement;
  const int few = parameters_.motion.min_matches;
  if (static_cast<int>(curr.points.size() + curr.lines.size()) < few) {
    measurement.reason = TrackingReason::kTooFewFeatures;
    return measurement;
  }
  const double dt_s = seconds(curr.stamp_ns - reference_->stamp_ns);
  const MotionPrediction prediction = predict(dt_s);
  {
    const StageTimer timer(times, Stage::kMatchCircular);
    measurement.matches =
        matchCircular(*reference_, curr, camera_, prediction, parameters_.matching);
    measurement.correspondences = makeCorrespondences(*reference_, curr, measurement.matches,
                                                      refinement_.correction(), parameters_);
  }
  {
    const StageTimer timer(times, Stage::kEstimate);
    measurement.motion = estimateMotion(measurement.correspondences, camera_,
                                        prediction.T_curr_prev, parameters_.motion);
  }
  if (parameters_.motion.fuse_rotation && before_reference_ && measurement.motion.ok()) {
    const StageTimer timer(times, Stage::kFuse);
    measurement.motion = fuseWithTwoFrameEstimate(curr, measurement);
  }
  measurement.reason = reasonOf(measurement.motion.status);
  if (measurement.motion.ok()) {
    const Vector6d velocity = velocityOfMotion(measurement.motion.T_curr_prev.inverse(), dt_s);
    const bool too_fast =
        velocity.head<3>().norm() > parameters_.tracking.max_speed_m_s ||
        velocity.tail<3>().norm() * 180.0 / M_PI > parameters_.tracking.max_turn_rate_deg_s;
    if (too_fast) measurement.reason = TrackingReason::kTooFast;
  }
  return measurement;
}

MotionEstimate StereoOdometry::fuseWithTwoFrameEstimate(const StereoFrame& curr,
                                                        const Measurement& measurement) const {
  const Eigen::Isometry3d T_prev_prev2 = before_reference_->T_reference_before;
  const Eigen::Isometry3d expected = measurement.motion.T_curr_prev * T_prev_prev2;
  const StereoFrame& prev2 = before_reference_->frame;
  const CircularMatches matches =
      matchCircular(prev2, curr, camera_, {expected, parameters_.matching.search_radius_px},
                    parameters_.matching);
  const MotionEstimate over_two = estimateMotion(
      makeCorrespondences(prev2, curr, matches, refinement_.correction(), parameters_), camera_,
      expected, parameters_.motion);
  if (!over_two.ok()) return measurement.motion;
  return fuseRotation(measurement.motion, over_two.T_curr_prev, T_prev_prev2,
                      measurement.correspondences, camera_, parameters_.motion);
}

MotionPrediction StereoOdometry::predict(double dt_s) const {
  if (!velocity_)
    return {Eigen::Isometry3d::Identity(), parameters_.matching.search_radius_without_velocity_px};
  const double widening = std::clamp(dt_s / velocity_->measured_over_s, 1.0, kMaxWidening);
  return {motionAtVelocity(velocity_->value, dt_s).inverse(),
          widening * parameters_.matching.search_radius_px};
}

void StereoOdometry::integrateMeasurement(const Measurement& measurement, const StereoFrame& curr) {
  const double dt_s = seconds(curr.stamp_ns - reference_->stamp_ns);
  const Eigen::Isometry3d T_prev_curr = measurement.motion.T_curr_prev.inverse();
  const Matrix6d& covariance = measurement.motion.covariance;
  pose_covariance_ =
      composeCovariance(T_odom_reference_, reference_covariance_, T_prev_curr, covariance);
  T_odom_camera_ = T_odom_reference_ * T_prev_curr;
  T_odom_camera_.linear() =
      Eigen::Quaterniond(T_odom_camera_.linear()).normalized().toRotationMatrix();
  velocity_ = Velocity{velocityOfMotion(T_prev_curr, dt_s), covariance / (dt_s * dt_s), dt_s,
                       curr.stamp_ns};
  state_ = TrackingState::kOk;
}

void StereoOdometry::integratePrediction(const StereoFrame& curr, double dt_s) {
  const double unmeasured_s = velocity_ ? seconds(curr.stamp_ns - velocity_->stamp_ns) : dt_s;
  const bool hold = !velocity_ || unmeasured_s > parameters_.tracking.max_prediction_s;
  const Vector6d velocity = velocity_ ? velocity_->value : Vector6d::Zero();
  const Eigen::Isometry3d T_prev_curr =
      hold ? Eigen::Isometry3d::Identity() : motionAtVelocity(velocity, dt_s);
  pose_covariance_ = composeCovariance(T_odom_camera_, pose_covariance_, T_prev_curr,
                                       predictionCovariance(velocity, !hold, dt_s, unmeasured_s));
  T_odom_camera_ = T_odom_camera_ * T_prev_curr;
  state_ = hold ? TrackingState::kLost : TrackingState::kDegraded;
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
  if (measurement.motion.ok() && measurement.reason == TrackingReason::kNone &&
      parameters_.motion.fuse_rotation) {
    before_reference_ = EarlierFrame{std::move(*reference_), measurement.motion.T_curr_prev};
  }
  if (measurement.reason != TrackingReason::kNone && state_ != TrackingState::kDegraded)
    velocity_.reset();
  reference_ = std::move(curr);
  T_odom_reference_ = T_odom_camera_;
  reference_covariance_ = pose_covariance_;
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
  velocity_.reset();
  last_stamp_ns_.reset();
  refinement_ = CalibrationRefinement(camera_);
  T_odom_camera_ = T_odom_reference_ = T_odom_camera;
  pose_covariance_ = reference_covariance_ = Matrix6d::Zero();
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
  detector_ = StereoFeatureDetector(parameters.points, parameters.lines);
  startNewReference();
}

void StereoOdometry::startNewReference() {
  reference_.reset();
  before_reference_.reset();
}

}  // namespace point_line_odometry
