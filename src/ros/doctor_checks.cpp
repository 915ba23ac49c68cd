#include "ros/doctor_checks.h"

#include <exception>
#include <opencv2/core.hpp>
#include <stdexcept>
#include <utility>
#include <vector>

#include "checks/seam_check.h"
#include "common/input_error.h"
#include "common/statistics.h"
#include "ros/calibration_conversion.h"
#include "ros/conversions.h"
#include "ros/doctor_facts.h"
#include "ros/image_conversion.h"

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

void MaskFacts::add(const ProcessedFrame& frame) {
  const auto shareOf = [](const cv::Mat& mask) {
    if (mask.empty()) return 0.0;
    return 1.0 - static_cast<double>(cv::countNonZero(mask)) / static_cast<double>(mask.total());
  };
  left_share = shareOf(frame.masks.left);
  right_share = shareOf(frame.masks.right);
  ++frames;
  missing += static_cast<std::uint64_t>(frame.masks.missing);
  if (!frame.masks.fault.empty()) fault = frame.masks.fault;
  rim.add(frame.result, frame.left_mask);
}

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
       {&PairMeasurement::row_offset_px, &PairMeasurement::vertical_disparity_px,
        &PairMeasurement::disparity_px, &PairMeasurement::behind_infinity_share,
        &PairMeasurement::brightness_ratio, &PairMeasurement::obscured_left,
        &PairMeasurement::obscured_right}) {
    current.*field = medianOf(window_, field);
  }
  return current;
}

std::optional<double> PairTrend::verticalDrift_px() const {
  if (!first_row_offset_px_) return std::nullopt;
  return medianOf(window_, &PairMeasurement::row_offset_px) - *first_row_offset_px_;
}

DoctorChecks::DoctorChecks(const NodeParameters& parameters, bool remembers)
    : parameters_(parameters), remembers_(remembers) {
  try {
    masks_ = StaticMasks({parameters.left.mask, parameters.right.mask});
  } catch (const InputError& error) {
    mask_fault_ = error.what();
  }
}

/// False if it is another one than before that is not confirmed yet: the set is not used.
bool DoctorChecks::takeCalibration(const StereoMessages& messages) {
  if (!messages.left_info || !messages.right_info) return true;
  const InfoPair infos{messages.left_info, messages.right_info};
  if (!remembers_) calibration_change_.clear();
  if (infos_ && *infos_ == infos) {
    other_infos_.clear();
    return true;
  }
  if (infos_) {
    calibration_change_ = differenceOf(infos, *infos_);
    if (!other_infos_.add(infos)) return false;
  }
  infos_ = infos;
  camera_.reset();
  rectifier_.reset();
  calibration_fault_.clear();
  trend_ = PairTrend();
  sequence_.reset();
  seam_.reset();
  try {
    calibration_ = toStereoCalibration(*infos.left, *infos.right);
    camera_ = rectifiedCamera(calibration_);
  } catch (const MessageError& error) {
    calibration_fault_ = error.what();
  } catch (const std::invalid_argument& error) {
    calibration_fault_ = std::string("camera_info: ") + error.what();
  }
  return true;
}

template <typename Use>
void DoctorChecks::useImages(const StereoMessages& set, const Use& use) {
  if (!takeCalibration(set) || (parameters_.rectify && !camera_)) return;
  try {
    use(imagesOf(set));
    if (!remembers_) damage_.clear();
  } catch (const MessageError& error) {
    damage_ = error.what();
  } catch (const std::invalid_argument& error) {
    calibration_fault_ = std::string("camera_info: ") + error.what();
    camera_.reset();
  }
}

void DoctorChecks::measure(const StereoMessages& set) {
  useImages(set, [&](const StereoImages& images) {
    noteSeam(commonSeam(toGray(*set.left), toGray(*set.right)));
    trend_.add(measurePair(images.left, images.right, images.left_mask, images.right_mask));
  });
}

/// A seam counts if it is in all pairs, in the same place.
void DoctorChecks::noteSeam(std::optional<int> column) {
  if (seam_) column = *seam_ == column ? column : std::nullopt;
  seam_ = column;
}

void DoctorChecks::follow(const StereoMessages& set) {
  useImages(set, [this](const StereoImages& images) {
    if (!sequence_)
      sequence_.emplace(camera_ ? std::make_optional(calibration_.left) : std::nullopt);
    sequence_->add(images);
  });
}

/// The rectifier is built for a size only once images have that size.
StereoImages DoctorChecks::imagesOf(const StereoMessages& set) {
  if (!parameters_.rectify) {
    StereoImages images{toGray(*set.left), toGray(*set.right),
                        toNanoseconds(set.left->header.stamp)};
    addMasks(set, &images);
    return images;
  }
  StereoImages raw = toStereoImages(*set.left, *set.right, calibration_);
  addMasks(set, &raw);
  if (!rectifier_) rectifier_.emplace(calibration_);
  return rectifier_->rectify(raw);
}

/// Masks that cannot be used are left out: the line on masks has the reason.
void DoctorChecks::addMasks(const StereoMessages& set, StereoImages* images) const {
  const bool fits = camera_ && images->left.size() == images->right.size() &&
                    images->left.cols == calibration_.left.width &&
                    images->left.rows == calibration_.left.height;
  if (!fits) return;
  const auto take = [](const sensor_msgs::ImageConstPtr& mask, const CameraCalibration& camera) {
    try {
      if (mask) return toMask(*mask, camera);
    } catch (const MessageError&) {
    }
    return cv::Mat();
  };
  images->left_mask = take(set.left_mask, calibration_.left);
  images->right_mask = take(set.right_mask, calibration_.right);
  if (masks_.sizeFault(calibration_).empty()) masks_.addTo(images);
}

DoctorFacts DoctorChecks::facts(const InputFacts& input, const tf2::BufferCore& tf) {
  if (!infos_) takeCalibration(input.latest);  // without a complete set
  DoctorFacts facts;
  facts.parameters = parameters_;
  facts.input = input;
  facts.images = {imageFacts(input.latest.left, "left"), imageFacts(input.latest.right, "right")};
  facts.camera = camera_;
  facts.calibration_fault = calibration_fault_;
  facts.calibration_change = calibration_change_;
  facts.damage = damage_;
  facts.mask_fault = camera_ && mask_fault_.empty() ? masks_.sizeFault(calibration_) : mask_fault_;
  facts.pair = trend_.current();
  facts.seam_column = seam_.value_or(std::nullopt);
  facts.vertical_drift_px = trend_.verticalDrift_px();
  if (sequence_) facts.sequence = sequence_->measurement();
  if (!input.latest.left) return facts;
  facts.camera_frame = withoutLeadingSlash(input.latest.left->header.frame_id);
  facts.T_base_camera = findMounting(facts.camera_frame, tf);
  facts.topmost_frame = topmostFrame(tf, facts.camera_frame, parameters_.odom_frame_id);
  return facts;
}

void addOtherParents(const std::vector<TfParents::Source>& others, const tf2::BufferCore& tf,
                     DoctorFacts* facts) {
  facts->other_parents = others;
  if (others.empty()) return;
  facts->topmost_of_other =
      topmostFrame(tf, others.front().parent, facts->parameters.odom_frame_id);
}

std::optional<Eigen::Isometry3d> DoctorChecks::findMounting(const std::string& camera_frame,
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
