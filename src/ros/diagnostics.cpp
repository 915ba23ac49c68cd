#include "ros/diagnostics.h"

#include <diagnostic_msgs/DiagnosticStatus.h>
#include <ros/console.h>

#include <algorithm>
#include <cmath>
#include <initializer_list>
#include <sstream>

#include "common/statistics.h"

namespace point_line_odometry {
namespace {

using diagnostic_msgs::DiagnosticStatus;

constexpr double kRepeatPeriodS = 60.0;  // of a warning that persists
constexpr double kShownS = 10.0;         // what happened to a single frame or message

constexpr const char* kRepeats =
    "images are those of the frame before, byte for byte: the camera's driver repeats them (or a "
    "simulated camera without noise has stopped at once)";

bool isRecent(const std::optional<ros::WallTime>& time) {
  return time && (ros::WallTime::now() - *time).toSec() < kShownS;
}

std::uint8_t levelOf(TrackingState state) {
  switch (state) {
    case TrackingState::kInitializing:
    case TrackingState::kOk:
      return DiagnosticStatus::OK;
    case TrackingState::kDegraded:
      return DiagnosticStatus::WARN;
    case TrackingState::kLost:
      break;
  }
  return DiagnosticStatus::ERROR;
}

/// Adds the lines on these subjects to a status: those that failed to its summary, unless that is
/// an error already, and the values of all.
void mergeLines(const std::vector<DoctorLine>& lines, std::initializer_list<DoctorSubject> subjects,
                diagnostic_updater::DiagnosticStatusWrapper* status) {
  const bool known = status->level >= DiagnosticStatus::ERROR;
  for (const DoctorLine& line : lines) {
    if (std::find(subjects.begin(), subjects.end(), line.subject) == subjects.end()) continue;
    if (line.failed() && !known) {
      status->mergeSummary(
          line.level == DoctorLevel::kError ? DiagnosticStatus::ERROR : DiagnosticStatus::WARN,
          std::string(toString(line.subject)) + ": " + line.text + "; " + line.hint);
    }
    const bool topic = line.subject <= DoctorSubject::kRightInfo;
    const std::string prefix = topic ? std::string(toString(line.subject)) + " " : "";
    for (const auto& [key, value] : line.values) status->add(prefix + key, value);
  }
}

/// Adds a source of motion priors: whether its samples come, and how many could not be used and
/// why.
void reportSource(const std::string& name, const SourceFacts& source,
                  diagnostic_updater::DiagnosticStatusWrapper* status) {
  const std::string fault_of_source = faultOf(name, source);
  if (!fault_of_source.empty()) status->mergeSummary(DiagnosticStatus::WARN, fault_of_source);
  status->add(name, source.counts.received);
  const auto addUnused = [&](const std::string& fault, std::uint64_t count) {
    if (count > 0) status->add(name + " not used: " + fault, count);
  };
  addUnused("no pose", source.counts.malformed);
  for (const auto& [fault, count] : source.unused) addUnused(fault, count);
}

}  // namespace

Diagnostics::Diagnostics(const ros::NodeHandle& nh, const ros::NodeHandle& private_nh,
                         const NodeParameters& parameters, const std::string& name)
    : watchdog_timeout_s_(parameters.watchdog_timeout_s),
      time_of_last_rate_(ros::WallTime::now()),
      updater_(nh, private_nh, name) {
  updater_.setHardwareID("stereo camera");
  updater_.add("tracking", this, &Diagnostics::reportTracking);
  updater_.add("input", this, &Diagnostics::reportInput);
  updater_.add("calibration", this, &Diagnostics::reportCalibration);
}

void Diagnostics::noteFrame(const ProcessedFrame& frame, double latency_ms) {
  const std::lock_guard<std::mutex> lock(mutex_);
  if (!frame.result.accepted()) {
    ++counters_.rejected;
    problem_ = std::string("frame rejected: ") + toString(frame.result.reason);
    return;
  }
  ++counters_.processed;
  problem_.clear();
  state_ = frame.result.state;
  reason_ = frame.result.reason;
  latency_ms_ = latency_ms;
  feature_budget_ = frame.feature_budget;
  prior_ = frame.result.prior;
  floor_trusted_ = frame.floor_trusted;
  ++priors_[prior_.use];
  if (line_detector_ != frame.line_detector) {
    ROS_INFO("detector of line segments: %s", toString(frame.line_detector));
  }
  line_detector_ = frame.line_detector;
  if (reason_ == TrackingReason::kRepeatedImages) noteRepeatedImages();
  failed_windows_ += static_cast<std::uint64_t>(frame.result.counts.failed_windows);
  counters_.relocalizations += static_cast<std::uint64_t>(frame.result.counts.relocalizations);
  counters_.masks_missing += static_cast<std::uint64_t>(frame.masks.missing);
  if (!masks_) masks_.emplace();
  masks_->add(frame);
  correction_px_ = frame.correction_px;
  if (!frame.result.processed()) return;
  constexpr std::size_t kRemembered = 20;
  process_ms_.push_back(frame.result.times.total_ms);
  if (process_ms_.size() > kRemembered) process_ms_.pop_front();
}

void Diagnostics::noteRepeatedImages() {
  ++repeated_images_;
  time_of_repeated_images_ = ros::WallTime::now();
  if (log_throttle_.passes("repeated images", kRepeatPeriodS)) ROS_WARN("%s", kRepeats);
}

void Diagnostics::noteDropped() {
  const std::lock_guard<std::mutex> lock(mutex_);
  ++counters_.dropped;
}

void Diagnostics::noteRejected(const std::string& reason) {
  const std::lock_guard<std::mutex> lock(mutex_);
  ++counters_.rejected;
  problem_ = "frame rejected: " + reason;
}

void Diagnostics::noteException(const std::string& text) {
  const std::lock_guard<std::mutex> lock(mutex_);
  ++counters_.exceptions;
  problem_ = "exception: " + text;
}

void Diagnostics::noteRejectedStamp(const std::string& text) {
  const std::lock_guard<std::mutex> lock(mutex_);
  ++counters_.stamps_rejected;
  rejected_stamp_ = text;
  time_of_rejected_stamp_ = ros::WallTime::now();
}

void Diagnostics::notePaused(bool paused) {
  const std::lock_guard<std::mutex> lock(mutex_);
  paused_ = paused;
}

void Diagnostics::noteWaitingForTransform(const std::string& text) {
  const std::lock_guard<std::mutex> lock(mutex_);
  problem_ = text;
}

void Diagnostics::noteImu(std::optional<SourceFacts> imu) {
  const std::lock_guard<std::mutex> lock(mutex_);
  imu_ = std::move(imu);
}

void Diagnostics::noteWheels(std::optional<SourceFacts> wheels) {
  const std::lock_guard<std::mutex> lock(mutex_);
  wheels_ = std::move(wheels);
}

void Diagnostics::noteCheck(const std::vector<DoctorLine>& lines) {
  for (const DoctorLine& line : lines) {
    const bool of_pair =
        line.subject == DoctorSubject::kRectification || line.subject == DoctorSubject::kDisparity;
    if (!of_pair || !line.failed()) continue;
    if (log_throttle_.passes(toString(line.subject), kRepeatPeriodS)) {
      ROS_WARN_STREAM(line.text << "; " << line.hint);
    }
  }
  const std::lock_guard<std::mutex> lock(mutex_);
  doctor_lines_ = lines;
}

std::optional<double> Diagnostics::meanFrameMs() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  if (process_ms_.size() < 2) return std::nullopt;
  return mean(std::vector<double>(process_ms_.begin(), process_ms_.end()));
}

std::optional<MaskFacts> Diagnostics::masks() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  return masks_;
}

std::optional<Eigen::Vector2d> Diagnostics::correctionPx() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  return correction_px_;
}

std::optional<SourceFacts> Diagnostics::imu() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  return imu_;
}

std::optional<SourceFacts> Diagnostics::wheels() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  return wheels_;
}

FrameCounters Diagnostics::counters() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  return counters_;
}

void Diagnostics::update(const StereoSubscriber& subscriber) {
  watchInput(subscriber);
  updater_.force_update();
}

void Diagnostics::watchInput(const StereoSubscriber& subscriber) {
  const double timeout_s = subscriber.secondsSinceSet();
  const bool timed_out = timeout_s > watchdog_timeout_s_;
  const std::string timeout = timed_out ? subscriber.explainTimeout() : std::string();
  if (timed_out) {
    if (log_throttle_.passes("no synchronised stereo images")) {
      ROS_WARN_STREAM("no synchronised stereo images for " << std::lround(timeout_s) << " s; "
                                                           << timeout);
    }
  }
  const InputFacts input = subscriber.facts();
  const std::lock_guard<std::mutex> lock(mutex_);
  timeout_ = timeout;
  num_sets_ = input.sets;
  num_unsynchronized_ = input.unsynchronized;
}

void Diagnostics::reportTracking(Status& status) {
  const std::lock_guard<std::mutex> lock(mutex_);
  if (paused_) {
    status.summary(DiagnosticStatus::OK, "paused; call ~resume to go on");
  } else if (!problem_.empty()) {
    status.summary(DiagnosticStatus::ERROR, problem_);
  } else if (counters_.processed == 0) {
    status.summary(DiagnosticStatus::WARN, "no frame processed yet");
  } else if (reason_ == TrackingReason::kNone) {
    status.summary(levelOf(state_), toString(state_));
  } else {
    status.summary(levelOf(state_), std::string(toString(state_)) + ": " + toString(reason_));
  }
  if (!paused_ && counters_.processed > 0 && !timeout_.empty())
    status.mergeSummary(DiagnosticStatus::WARN, "no frame comes any more");
  status.add("rate [1/s]", takeRate());
  status.add("latency [ms]", latency_ms_);
  status.add("processing time [ms]", process_ms_.empty() ? 0.0 : process_ms_.back());
  status.add("feature budget", feature_budget_);
  if (line_detector_) status.add("line detector", toString(*line_detector_));
  status.add("frames processed", counters_.processed);
  status.add("frames dropped", counters_.dropped);
  status.add("frames rejected", counters_.rejected);
  status.add("exceptions", counters_.exceptions);
  status.add("failed windows", failed_windows_);
  status.add("relocalizations", counters_.relocalizations);
}

void Diagnostics::reportInput(Status& status) {
  const std::lock_guard<std::mutex> lock(mutex_);
  if (timeout_.empty()) {
    status.summary(DiagnosticStatus::OK, "receiving stereo images");
  } else {
    status.summary(DiagnosticStatus::ERROR, "no synchronised stereo images; " + timeout_);
  }
  if (isRecent(time_of_rejected_stamp_)) {
    status.mergeSummary(DiagnosticStatus::WARN, "message rejected: " + rejected_stamp_);
  }
  if (isRecent(time_of_repeated_images_)) status.mergeSummary(DiagnosticStatus::WARN, kRepeats);
  reportPriors(status);
  status.add("frames with repeated images", repeated_images_);
  status.add("synchronised sets", num_sets_);
  status.add("messages rejected for their stamp", counters_.stamps_rejected);
  status.add("last of these", rejected_stamp_.empty() ? "none" : rejected_stamp_);
  status.add("left images without partner", num_unsynchronized_);
  status.add("masks missing", counters_.masks_missing);
  mergeLines(doctor_lines_,
             {DoctorSubject::kLeftImage, DoctorSubject::kRightImage, DoctorSubject::kLeftInfo,
              DoctorSubject::kRightInfo, DoctorSubject::kStamps, DoctorSubject::kImages,
              DoctorSubject::kMasks, DoctorSubject::kSpeed, DoctorSubject::kClock},
             &status);
}

/// The IMU, the wheels, and how the frames used their motion priors.
void Diagnostics::reportPriors(Status& status) const {
  if (imu_) reportSource("imu samples", *imu_, &status);
  if (wheels_) reportSource("poses by wheels", *wheels_, &status);
  if (prior_.use == PriorUse::kSuspended) {
    status.mergeSummary(DiagnosticStatus::WARN,
                        "motion priors disagree with the images and are not used");
  }
  if (imu_ && !imu_->trusted) {
    status.mergeSummary(DiagnosticStatus::WARN,
                        "the rotation by the IMU disagrees with the images and is not used: check "
                        "the axes of the IMU in tf, its stamps and noise parameters");
  }
  if (!floor_trusted_) {
    status.mergeSummary(DiagnosticStatus::WARN,
                        "the robot does not move as on a flat floor, which is not used: check the "
                        "camera's pose in tf, and planar/z_deviation, roll_ and pitch_deviation");
  }
  if (wheels_ && !wheels_->trusted) {
    status.mergeSummary(DiagnosticStatus::WARN,
                        "the motion by wheels disagrees with the images and is not used: check "
                        "its scale, the camera's pose in tf, and wheels/slip_x, _y and _yaw");
  }
  for (const auto& [use, frames] : priors_) {
    if (use != PriorUse::kNone)
      status.add(std::string("frames with motion prior ") + toString(use), frames);
  }
}

void Diagnostics::reportCalibration(Status& status) {
  const std::lock_guard<std::mutex> lock(mutex_);
  if (counters_.processed == 0) {
    status.summary(DiagnosticStatus::WARN, "no calibration in use yet");
  } else {
    status.summary(DiagnosticStatus::OK, "calibrated pair");
  }
  mergeLines(doctor_lines_,
             {DoctorSubject::kCalibration, DoctorSubject::kBaseline, DoctorSubject::kRectification,
              DoctorSubject::kDisparity, DoctorSubject::kMounting},
             &status);
}

double Diagnostics::takeRate() {
  const ros::WallTime now = ros::WallTime::now();
  const double elapsed_s = (now - time_of_last_rate_).toSec();
  const auto frames = static_cast<double>(counters_.processed - processed_at_last_rate_);
  time_of_last_rate_ = now;
  processed_at_last_rate_ = counters_.processed;
  return elapsed_s > 0.0 ? frames / elapsed_s : 0.0;
}

}  // namespace point_line_odometry
