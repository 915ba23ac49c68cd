#include "ros/frame_processor.h"

#include <algorithm>
#include <stdexcept>
#include <string>
#include <utility>

#include "odometry/adaptive_feature_budget.h"
#include "ros/calibration_conversion.h"
#include "ros/conversions.h"
#include "ros/image_conversion.h"

namespace point_line_odometry {
namespace {

constexpr std::size_t kMaxEarlySamples = 2000;  // until the first frame

void checkFinite(const FrameResult& result) {
  if (result.T_odom_camera.matrix().allFinite() && result.pose_covariance.allFinite() &&
      result.twist.allFinite() && result.twist_covariance.allFinite()) {
    return;
  }
  throw std::runtime_error("the odometry gave a number that is not finite; nothing is published");
}

}  // namespace

FrameProcessor::FrameProcessor(AllParameters parameters)
    : parameters_(std::move(parameters)),
      static_masks_({parameters_.node.left.mask, parameters_.node.right.mask}),
      T_odom_base_(initialPose(parameters_.node)) {}

ProcessedFrame FrameProcessor::process(const StereoMessages& messages,
                                       const Eigen::Isometry3d& T_base_header) {
  was_reset_ = false;
  StereoImages received = receive(messages);
  ProcessedFrame frame;
  takeMasks(messages, &received, &frame.masks);
  takeMounting(T_base_header * calibration_->T_header_camera());
  handleTimeJump(received.stamp_ns);

  const StereoImages images =
      calibration_->rectifier ? calibration_->rectifier->rectify(received) : received;
  frame.header = messages.left->header;
  frame.header.frame_id = withoutLeadingSlash(frame.header.frame_id);
  frame.left = images.left;
  frame.left_mask = images.left_mask;
  frame.left_message = messages.left;
  frame.camera = calibration_->camera;
  frame.feature_budget = feature_budget_;
  frame.T_base_camera = T_base_camera_;
  frame.T_header_camera = calibration_->T_header_camera();
  if (observe_start_) observe_start_({*odometry_, continues_, T_odom_base_});
  continues_ = false;  // until the frame is done
  frame.prior = priorOf(images.stamp_ns);
  const bool newer = !last_stamp_ns_ || images.stamp_ns > *last_stamp_ns_;
  if (gravity_ && newer) frame.tilt = gravity_->takeCorrection();  // for a frame that is recorded
  if (frame.tilt) odometry_->correctTilt(*frame.tilt);
  frame.result = odometry_->process(images, frame.prior ? &*frame.prior : nullptr);
  if (gyroscope_) gyroscope_->update(frame.result);
  if (gravity_) gravity_->update(frame.result, *gyroscope_);
  if (wheels_) wheels_->update(frame.result);
  if (floor_) floor_->update(frame.result);
  frame.floor_trusted = !floor_ || floor_->isTrusted();
  frame.line_detector = odometry_->lineDetector();
  checkFinite(frame.result);
  continues_ = frame.result.reason != TrackingReason::kException;
  if (frame.result.accepted()) {
    T_odom_base_ = frame.T_odom_base();
    last_stamp_ns_ = images.stamp_ns;
  }
  return frame;
}

void FrameProcessor::addImu(const std::vector<ImuSample>& samples,
                            const Eigen::Isometry3d& T_base_imu) {
  if (!T_base_imu_ || !T_base_imu.isApprox(*T_base_imu_, 1e-9)) {
    T_base_imu_ = T_base_imu;
    startImu();
  }
  if (gyroscope_) {
    for (const ImuSample& sample : samples) gyroscope_->add(sample);
    return;
  }
  early_samples_.insert(early_samples_.end(), samples.begin(), samples.end());
  while (early_samples_.size() > kMaxEarlySamples) early_samples_.pop_front();
}

bool FrameProcessor::hasImuUntil(std::int64_t stamp_ns) const {
  return !gyroscope_ || gyroscope_->covers(stamp_ns);
}

/// Without samples until the base's poses of both, the camera and the IMU, are known.
void FrameProcessor::startImu() {
  gyroscope_.reset();
  gravity_.reset();
  if (!parameters_.core.imu.enabled || !T_base_imu_ || !odometry_) return;
  gyroscope_.emplace(parameters_.core.imu,
                     T_base_camera_.linear().transpose() * T_base_imu_->linear());
  startGravity();
  for (const ImuSample& sample : early_samples_) gyroscope_->add(sample);
  early_samples_.clear();
}

void FrameProcessor::startGravity() {
  gravity_.reset();
  if (gyroscope_ && parameters_.core.imu.use_gravity)
    gravity_.emplace(parameters_.core.imu, T_base_camera_.inverse() * *T_base_imu_);
}

std::optional<MotionPrior> FrameProcessor::priorOf(std::int64_t stamp_ns) {
  if (!last_stamp_ns_ || stamp_ns <= *last_stamp_ns_) return std::nullopt;
  std::vector<MotionPrior> priors;
  const auto add = [&](const std::optional<MotionPrior>& prior) {
    if (prior) priors.push_back(*prior);
    return prior.has_value();
  };
  const auto count = [](bool given, int* without) { *without = given ? 0 : *without + 1; };
  if (gyroscope_) count(add(gyroscope_->between(*last_stamp_ns_, stamp_ns)), &without_imu_);
  if (wheels_ && wheels_->isTrusted())
    count(add(wheels_->between(*last_stamp_ns_, stamp_ns)), &without_wheels_);
  if (floor_) add(floor_->between(*last_stamp_ns_, stamp_ns));
  return fused(priors);
}

void FrameProcessor::addWheels(const std::vector<OdometrySample>& samples,
                               const Eigen::Isometry3d& T_base_body) {
  if (!T_base_body_ || !T_base_body.isApprox(*T_base_body_, 1e-9)) {
    T_base_body_ = T_base_body;
    startWheels();
  }
  if (wheels_) {
    for (const OdometrySample& sample : samples) wheels_->add(sample);
    return;
  }
  early_wheel_samples_.insert(early_wheel_samples_.end(), samples.begin(), samples.end());
  while (early_wheel_samples_.size() > kMaxEarlySamples) early_wheel_samples_.pop_front();
}

bool FrameProcessor::hasWheelsUntil(std::int64_t stamp_ns) const {
  return !wheels_ || wheels_->covers(stamp_ns);
}

/// As startImu().
void FrameProcessor::startWheels() {
  wheels_.reset();
  if (!usesWheels(parameters_) || !T_base_body_ || !odometry_) return;
  wheels_.emplace(parameters_.core, T_base_body_->inverse() * T_base_camera_);
  for (const OdometrySample& sample : early_wheel_samples_) wheels_->add(sample);
  early_wheel_samples_.clear();
}

void FrameProcessor::startFloor() {
  floor_.reset();
  if (parameters_.core.planar.enabled) floor_.emplace(parameters_.core.planar, T_base_camera_);
}

void FrameProcessor::reset(const Eigen::Isometry3d& T_odom_base) {
  T_odom_base_ = T_odom_base;
  last_stamp_ns_.reset();
  startOdometry();
}

void FrameProcessor::setParameters(const Parameters& core) {
  const ImuParameters before = parameters_.core.imu;
  const bool used_wheels = usesWheels(parameters_);
  parameters_.core = core;
  if (core.imu.enabled != before.enabled) {
    startImu();
  } else if (core.imu.use_gravity != before.use_gravity) {
    startGravity();
  }
  if (usesWheels(parameters_) != used_wheels) startWheels();
  if (wheels_) wheels_->setParameters(core);
  if (core.planar.enabled != floor_.has_value()) startFloor();
  if (floor_) floor_->setParameters(core.planar);
  if (gyroscope_) gyroscope_->setParameters(core.imu);
  if (gravity_) gravity_->setParameters(core.imu);
  if (odometry_) odometry_->setParameters(budgetedParameters());
}

void FrameProcessor::observeStarts(std::function<void(const FrameStart&)> observe) {
  observe_start_ = std::move(observe);
}

void FrameProcessor::setFeatureBudget(double share) {
  if (share == feature_budget_) return;
  feature_budget_ = share;
  if (odometry_) odometry_->setParameters(budgetedParameters());
}

Parameters FrameProcessor::budgetedParameters() const {
  return withFeatureBudget(parameters_.core, feature_budget_);
}

Eigen::Isometry3d FrameProcessor::Calibration::T_header_camera() const {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  if (rectifier) T.linear() = rectifier->R_rectified_raw().transpose();
  return T;
}

bool FrameProcessor::InfoPair::operator==(const InfoPair& other) const {
  return sameCalibration(*left, *other.left) && sameCalibration(*right, *other.right);
}

/// The images as received, after checks of them and their calibration.
StereoImages FrameProcessor::receive(const StereoMessages& messages) {
  const InfoPair infos{messages.left_info, messages.right_info};
  if (calibration_ && calibration_->infos == infos) {
    other_infos_.clear();
    return toStereoImages(*messages.left, *messages.right, calibration_->stereo);
  }
  const bool confirmed = !calibration_ || other_infos_.add(infos);
  Calibration calibration = makeCalibration(infos);
  StereoImages images = toStereoImages(*messages.left, *messages.right, calibration.stereo);
  if (!confirmed) rejectUnconfirmed(infos);
  takeCalibration(std::move(calibration));
  return images;
}

/// A mask message that cannot be used is as good as none; a file of the wrong size is an error.
void FrameProcessor::takeMasks(const StereoMessages& messages, StereoImages* received,
                               FrameMasks* masks) const {
  const StereoCalibration& calibration = calibration_->stereo;
  const std::string fault = static_masks_.sizeFault(calibration);
  if (!fault.empty()) throw MessageError(fault);
  const auto take = [&](std::size_t camera, const sensor_msgs::ImageConstPtr& message,
                        const CameraCalibration& of_camera) -> cv::Mat {
    if (!expectsMask(parameters_.node, camera)) return {};
    try {
      if (message) return toMask(*message, of_camera);
    } catch (const MessageError& error) {
      masks->fault = std::string(camera == 0 ? "left " : "right ") + error.what();
    }
    ++masks->missing;
    return {};
  };
  received->left_mask = take(0, messages.left_mask, calibration.left);
  received->right_mask = take(1, messages.right_mask, calibration.right);
  static_masks_.addTo(received);
  masks->left = received->left_mask;
  masks->right = received->right_mask;
}

FrameProcessor::Calibration FrameProcessor::makeCalibration(const InfoPair& infos) {
  Calibration calibration;
  calibration.infos = infos;
  calibration.stereo = toStereoCalibration(*infos.left, *infos.right);
  try {
    calibration.camera = rectifiedCamera(calibration.stereo);
  } catch (const std::invalid_argument& error) {
    throw MessageError(std::string("camera_info: ") + error.what());
  }
  return calibration;
}

void FrameProcessor::rejectUnconfirmed(const InfoPair& infos) const {
  const InfoPair& known = calibration_->infos;
  const char* left = differingField(*infos.left, *known.left);
  const char* right = differingField(*infos.right, *known.right);
  throw MessageError(std::string(left ? "left" : "right") +
                     "/camera_info: " + (left ? left : right) +
                     " is not as in the frames before; it is accepted once " +
                     std::to_string(kConfirmations) + " frames in a row have it");
}

/// The rectifier is built for a size only once images have that size.
void FrameProcessor::takeCalibration(Calibration calibration) {
  try {
    if (parameters_.node.rectify) calibration.rectifier.emplace(calibration.stereo);
  } catch (const std::invalid_argument& error) {
    throw MessageError(std::string("camera_info: ") + error.what());
  }
  calibration_ = std::move(calibration);
  continues_ = false;
  if (odometry_) odometry_->setCamera(calibration_->camera);
}

/// A stamp that is older by at most kMaxLateness_s belongs to a late frame, which the core drops.
void FrameProcessor::handleTimeJump(std::int64_t stamp_ns) {
  announce(stamp_ns);
  if (parameters_.node.on_time_jump == "ignore" || !last_stamp_ns_) return;
  const double back_s = toSeconds(*last_stamp_ns_ - stamp_ns);
  if (back_s <= kMaxLateness_s) return;
  was_reset_ = parameters_.node.on_time_jump == "reset";
  if (was_reset_) {
    reset(initialPose(parameters_.node));
  } else {
    last_stamp_ns_.reset();
    continueOdometry();
  }
}

/// Also if a reset came between the samples and the jump.
void FrameProcessor::announce(std::int64_t stamp_ns) {
  if (parameters_.node.on_time_jump == "ignore") return;
  if (newest_stamp_ns_ && toSeconds(*newest_stamp_ns_ - stamp_ns) > kMaxLateness_s) {
    newest_stamp_ns_.reset();
    if (gyroscope_) gyroscope_->clear();
    if (wheels_) wheels_->clear();
  }
  newest_stamp_ns_ = std::max(newest_stamp_ns_.value_or(stamp_ns), stamp_ns);
}

void FrameProcessor::takeMounting(const Eigen::Isometry3d& T_base_camera) {
  const bool moved = !T_base_camera.isApprox(T_base_camera_, 1e-9);
  if (odometry_ && !moved) return;
  T_base_camera_ = T_base_camera;
  if (odometry_) {
    continueOdometry();
  } else {
    startOdometry();
  }
  startImu();
  startWheels();
  startFloor();
}

void FrameProcessor::startOdometry() {
  if (!calibration_) return;
  if (!odometry_) odometry_.emplace(calibration_->camera, budgetedParameters());
  odometry_->reset(T_odom_base_ * T_base_camera_);
  if (gravity_) gravity_->restart();
  continues_ = false;
}

/// Goes on from the base's last pose and its covariance.
void FrameProcessor::continueOdometry() {
  odometry_->continueAt(T_odom_base_ * T_base_camera_);
  if (gravity_) gravity_->restart();
  continues_ = false;
}

}  // namespace point_line_odometry
