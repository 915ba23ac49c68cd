#include "ros/doctor_examination.h"

#include <exception>
#include <stdexcept>
#include <utility>
#include <vector>

#include "common/statistics.h"
#include "ros/conversions.h"

namespace point_line_odometry {
namespace {

double medianOf(const std::deque<PairMeasurement>& measurements, double PairMeasurement::*field) {
  std::vector<double> values;
  values.reserve(measurements.size());
  for (const PairMeasurement& measurement : measurements) values.push_back(measurement.*field);
  return median(std::move(values));
}

std::optional<ImageFacts> imageFacts(const sensor_msgs::ImageConstPtr& message,
                                     const std::string& side) {
  if (!message) return std::nullopt;
  ImageFacts facts;
  facts.encoding = message->encoding;
  facts.width = static_cast<int>(message->width);
  facts.height = static_cast<int>(message->height);
  try {
    toGray(*message);
  } catch (const MessageError& error) {
    facts.fault = side + " " + error.what();
  }
  return facts;
}

}  // namespace

void PairTrend::add(const PairMeasurement& measurement) {
  latest_ = measurement;
  if (!measurement.valid()) return;
  window_.push_back(measurement);
  if (window_.size() > kWindow) window_.pop_front();
  if (!first_row_offset_px_ && window_.size() == kWindow) {
    first_row_offset_px_ = medianOf(window_, &PairMeasurement::row_offset_px);
  }
}

std::optional<PairMeasurement> PairTrend::current() const {
  if (!latest_ || !latest_->valid()) return latest_;
  PairMeasurement current = *latest_;
  for (double PairMeasurement::*field :
       {&PairMeasurement::row_offset_px, &PairMeasurement::row_distance_px,
        &PairMeasurement::disparity_px, &PairMeasurement::behind_infinity_share}) {
    current.*field = medianOf(window_, field);
  }
  return current;
}

std::optional<double> PairTrend::rowDrift_px() const {
  if (!first_row_offset_px_) return std::nullopt;
  return medianOf(window_, &PairMeasurement::row_offset_px) - *first_row_offset_px_;
}

DoctorExamination::DoctorExamination(const NodeParameters& parameters) : parameters_(parameters) {}

void DoctorExamination::takeCalibration(const StereoMessages& messages) {
  if (!messages.left_info || !messages.right_info) return;
  if (left_info_ && sameCalibration(*left_info_, *messages.left_info) &&
      sameCalibration(*right_info_, *messages.right_info)) {
    return;
  }
  left_info_ = messages.left_info;
  right_info_ = messages.right_info;
  camera_.reset();
  rectifier_.reset();
  calibration_fault_.clear();
  trend_ = PairTrend();
  try {
    calibration_ = toStereoCalibration(*left_info_, *right_info_);
    camera_ = rectifiedCamera(calibration_);
  } catch (const MessageError& error) {
    calibration_fault_ = error.what();
  } catch (const std::invalid_argument& error) {
    calibration_fault_ = std::string("camera_info: ") + error.what();
  }
}

void DoctorExamination::measure(const StereoMessages& set) {
  takeCalibration(set);
  if (parameters_.rectify && !camera_) return;
  try {
    const StereoImages images = parameters_.rectify
                                    ? rectify(toStereoImages(*set.left, *set.right, calibration_))
                                    : StereoImages{toGray(*set.left), toGray(*set.right), 0};
    trend_.add(measurePair(images.left, images.right));
  } catch (const MessageError&) {
    // The facts say it: they look at the latest messages in the same way.
  } catch (const std::invalid_argument& error) {
    calibration_fault_ = std::string("camera_info: ") + error.what();
    camera_.reset();
  }
}

/// Look-up tables are made only for the size that the images have.
StereoImages DoctorExamination::rectify(const StereoImages& raw) {
  if (!rectifier_) rectifier_.emplace(calibration_);
  return rectifier_->rectify(raw);
}

DoctorFacts DoctorExamination::facts(const InputFacts& input, const tf2::BufferCore& tf) {
  takeCalibration(input.latest);
  DoctorFacts facts;
  facts.parameters = parameters_;
  facts.input = input;
  facts.images = {imageFacts(input.latest.left, "left"), imageFacts(input.latest.right, "right")};
  facts.camera = camera_;
  facts.calibration_fault = calibration_fault_;
  facts.pair = trend_.current();
  facts.row_drift_px = trend_.rowDrift_px();
  if (!input.latest.left) return facts;
  facts.camera_frame = withoutLeadingSlash(input.latest.left->header.frame_id);
  facts.T_base_camera = findMounting(facts.camera_frame, tf);
  return facts;
}

std::optional<Eigen::Isometry3d> DoctorExamination::findMounting(const std::string& camera_frame,
                                                                 const tf2::BufferCore& tf) const {
  if (camera_frame.empty()) return std::nullopt;
  try {
    return toIsometry(
        tf.lookupTransform(parameters_.base_frame_id, camera_frame, ros::Time(0)).transform);
  } catch (const std::exception&) {
    return std::nullopt;
  }
}

}  // namespace point_line_odometry
