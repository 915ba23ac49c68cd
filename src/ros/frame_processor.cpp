#include "ros/frame_processor.h"

#include <stdexcept>
#include <string>
#include <utility>

#include "odometry/compute_governor.h"
#include "ros/conversions.h"

namespace point_line_odometry {
namespace {

void checkFinite(const FrameResult& result) {
  if (result.T_odom_camera.matrix().allFinite() && result.pose_covariance.allFinite() &&
      result.twist.allFinite() && result.twist_covariance.allFinite()) {
    return;
  }
  throw std::runtime_error("the odometry gave a number that is not finite; nothing is published");
}

}  // namespace

FrameProcessor::FrameProcessor(AllParameters parameters)
    : parameters_(std::move(parameters)), T_odom_base_(initialPose(parameters_.node)) {}

ProcessedFrame FrameProcessor::process(const StereoMessages& messages,
                                       const Eigen::Isometry3d& T_base_header) {
  started_anew_ = false;
  const StereoImages received = receive(messages);
  takeMounting(T_base_header * calibration_->T_header_camera());
  handleTimeJump(received.stamp_ns);

  const StereoImages images =
      calibration_->rectifier ? calibration_->rectifier->rectify(received) : received;
  ProcessedFrame frame;
  frame.header = messages.left->header;
  frame.header.frame_id = withoutLeadingSlash(frame.header.frame_id);
  frame.left = images.left;
  frame.left_message = messages.left;
  frame.camera = calibration_->camera;
  frame.feature_budget = feature_budget_;
  frame.T_base_camera = T_base_camera_;
  frame.T_header_camera = calibration_->T_header_camera();
  if (observe_start_) observe_start_({*odometry_, continues_, T_odom_base_});
  continues_ = false;  // until the frame is done
  frame.result = odometry_->process(images);
  frame.line_detector = odometry_->lineDetector();
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

/// The images as they came, once they and their calibration are checked.
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
  throw MessageError(std::string(left ? "left" : "right") + "/camera_info: " +
                     (left ? left : right) + " is not as in the frames before; it is taken once " +
                     std::to_string(kConfirmations) + " frames in a row have it");
}

/// Look-up tables are made only for the size that the images have.
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

/// A stamp that is older by no more than a gap between frames is one of a frame that comes late;
/// the core drops it.
void FrameProcessor::handleTimeJump(std::int64_t stamp_ns) {
  if (!last_stamp_ns_ || parameters_.node.on_time_jump == "ignore") return;
  const double back_s = toSeconds(*last_stamp_ns_ - stamp_ns);
  if (back_s <= kMaxLateness_s) return;
  started_anew_ = parameters_.node.on_time_jump == "reset";
  reset(started_anew_ ? initialPose(parameters_.node) : T_odom_base_);
}

void FrameProcessor::takeMounting(const Eigen::Isometry3d& T_base_camera) {
  const bool moved = !T_base_camera.isApprox(T_base_camera_, 1e-9);
  if (odometry_ && !moved) return;
  T_base_camera_ = T_base_camera;
  startOdometry();
}

void FrameProcessor::startOdometry() {
  if (!calibration_) return;
  if (!odometry_) odometry_.emplace(calibration_->camera, budgetedParameters());
  odometry_->reset(T_odom_base_ * T_base_camera_);
  continues_ = false;
}

}  // namespace point_line_odometry
