#include "ros/frame_processor.h"

#include <algorithm>
#include <stdexcept>
#include <string>
#include <utility>

#include "ros/calibration_conversion.h"
#include "ros/conversions.h"
#include "ros/image_conversion.h"

namespace point_line_odometry {
namespace {

/// With wheels also if tf replaces them.
Parameters ofPriorSources(const AllParameters& parameters) {
  Parameters core = parameters.core;
  core.wheels.enabled = usesWheels(parameters);
  return core;
}

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
      prior_sources_(ofPriorSources(parameters_)),
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
  frame.feature_budget = feature_budget_.share;
  frame.T_base_camera = T_base_camera_;
  frame.T_header_camera = calibration_->T_header_camera();
  if (observe_start_) observe_start_({*odometry_, continues_, T_odom_base_});
  continues_ = false;  // until the frame is done
  const bool newer = !last_stamp_ns_ || images.stamp_ns > *last_stamp_ns_;
  if (newer && last_stamp_ns_)
    frame.prior = prior_sources_.takePrior(*last_stamp_ns_, images.stamp_ns);
  if (newer) frame.tilt = prior_sources_.takeTiltCorrection();  // for a frame that is recorded
  if (frame.tilt) odometry_->correctTilt(*frame.tilt);
  frame.result = odometry_->process(images, frame.prior ? &*frame.prior : nullptr);
  prior_sources_.update(frame.result);
  const PlanarFloor* floor = prior_sources_.floor();
  frame.floor_trusted = floor == nullptr || floor->isTrusted();
  frame.line_detector = odometry_->lineDetector();
  frame.correction_px = odometry_->correction().rmsPx(odometry_->camera());
  checkFinite(frame.result);
  continues_ = frame.result.reason != TrackingReason::kException;
  if (frame.result.accepted()) {
    T_odom_base_ = frame.T_odom_base();
    last_stamp_ns_ = images.stamp_ns;
  }
  return frame;
}

void FrameProcessor::reset(const Eigen::Isometry3d& T_odom_base) {
  T_odom_base_ = T_odom_base;
  last_stamp_ns_.reset();
  startOdometry();
}

void FrameProcessor::setParameters(const Parameters& core) {
  parameters_.core = core;
  prior_sources_.setParameters(ofPriorSources(parameters_));
  if (odometry_) odometry_->setParameters(budgetedParameters());
}

void FrameProcessor::observeStarts(std::function<void(const FrameStart&)> observe) {
  observe_start_ = std::move(observe);
}

void FrameProcessor::setFeatureBudget(const FeatureBudget& budget) {
  if (budget == feature_budget_) return;
  feature_budget_ = budget;
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
  throw MessageError(differenceOf(infos, calibration_->infos) +
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
    prior_sources_.discardSamples();
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
  prior_sources_.setCamera(T_base_camera_);
}

void FrameProcessor::startOdometry() {
  if (!calibration_) return;
  if (!odometry_) odometry_.emplace(calibration_->camera, budgetedParameters());
  odometry_->reset(T_odom_base_ * T_base_camera_);
  prior_sources_.restartGravity();
  continues_ = false;
}

/// Goes on from the base's last pose and its covariance.
void FrameProcessor::continueOdometry() {
  odometry_->continueAt(T_odom_base_ * T_base_camera_);
  prior_sources_.continueGravity();
  continues_ = false;
}

}  // namespace point_line_odometry
