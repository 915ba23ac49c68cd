#include "ros/prior_inputs.h"

#include <ros/console.h>

#include <exception>

#include "ros/conversions.h"

namespace point_line_odometry {

PriorInputs::PriorInputs(const ros::NodeHandle& nh, std::string name, NodeParameters parameters,
                         const tf2_ros::Buffer& tf, const SensorMounting::Lookup& look_up)
    : nh_(nh),
      name_(std::move(name)),
      parameters_(std::move(parameters)),
      imu_sensor_({"imu", look_up}),
      wheel_sensor_({"prior_odom", look_up}) {
  if (usesTfGuess(parameters_)) {
    guess_.emplace(tf, parameters_.guess_frame_id, parameters_.base_frame_id);
  }
}

void PriorInputs::enable(const Parameters& core) {
  if (core.imu.enabled) {
    imu_.subscribe(nh_);
  } else {
    imu_.unsubscribe();
  }
  if (core.wheels.enabled && !guess_) {
    wheels_.subscribe(nh_);
  } else {
    wheels_.unsubscribe();
  }
}

void PriorInputs::takeUntil(const ros::Time& stamp, PriorSources* sources) {
  frame_ns_ = toNanoseconds(stamp);
  if (imu_.enabled()) takeImu(sources);
  if (guess_) {
    takeGuess(stamp, sources);
  } else if (wheels_.enabled()) {
    takeWheels(sources);
  }
}

void PriorInputs::takeImu(PriorSources* sources) {
  imu_.takeUntil(
      [&](const FramedSample<ImuSample>& imu) {
        imu_sensor_.newest_ns = imu.sample.stamp_ns;
        const Eigen::Isometry3d* T_base_imu = poseOf(imu.frame_id, &imu_sensor_);
        if (T_base_imu != nullptr) sources->addImu(imu.sample, *T_base_imu);
      },
      [&] { return sources->hasImuUntil(frame_ns_); });
  warnIfSilent(imu_.counts().alive, imuTimeout(), &imu_sensor_);
}

/// A message without child_frame_id is of the base.
void PriorInputs::takeWheels(PriorSources* sources) {
  wheels_.takeUntil(
      [&](const FramedSample<OdometrySample>& pose) {
        wheel_sensor_.newest_ns = pose.sample.stamp_ns;
        const std::string& body = pose.frame_id.empty() ? parameters_.base_frame_id : pose.frame_id;
        const Eigen::Isometry3d* T_base_body = poseOf(body, &wheel_sensor_);
        if (T_base_body != nullptr) sources->addWheels(pose.sample, *T_base_body);
      },
      [&] { return sources->hasWheelsUntil(frame_ns_); });
  warnIfSilent(wheels_.counts().alive, wheelTimeout(), &wheel_sensor_);
}

void PriorInputs::takeGuess(const ros::Time& stamp, PriorSources* sources) {
  T_guess_base_ = guess_->lookUp(stamp);
  if (!T_guess_base_) {
    ++missing_guesses_;
    if (log_throttle_.passes("no motion prior")) {
      ROS_WARN_NAMED(name_,
                     "no motion prior, and no tf from %s: tf has no %s -> %s at the image's stamp",
                     parameters_.odom_frame_id.c_str(), parameters_.guess_frame_id.c_str(),
                     parameters_.base_frame_id.c_str());
    }
    return;
  }
  ++num_guesses_;
  OdometrySample sample;
  sample.stamp_ns = toNanoseconds(stamp);
  sample.T_odom_body = *T_guess_base_;
  sources->addWheels(sample, Eigen::Isometry3d::Identity());
}

/// The pose of a sensor in the base. Null if it is not known: counted, named, and said in the log.
const Eigen::Isometry3d* PriorInputs::poseOf(const std::string& frame, Sensor* sensor) {
  try {
    sensor->mounting.prepare(frame);
    const Eigen::Isometry3d& T_base_sensor = sensor->mounting.take(frame);
    sensor->fault.clear();
    return &T_base_sensor;
  } catch (const MessageError& error) {
    sensor->fault = error.what();
  } catch (const std::exception& error) {
    sensor->fault = "no transform from " + parameters_.base_frame_id + " to the frame '" + frame +
                    "' (" + error.what() + ")";
  }
  ++sensor->unmounted;
  if (log_throttle_.passes("a sample is not used")) {
    ROS_WARN_NAMED(name_, "a sample is not used: %s", sensor->fault.c_str());
  }
  return nullptr;
}

/// Once, when a source has been silent for so many frames; /diagnostics says it all the time.
void PriorInputs::warnIfSilent(bool alive, const std::string& timeout, Sensor* sensor) const {
  sensor->silent_frames = alive ? 0 : sensor->silent_frames + 1;
  if (sensor->silent_frames == SourceFacts::kManyFrames) {
    ROS_WARN_NAMED(name_, "%s", timeout.c_str());
  }
}

std::string PriorInputs::imuTimeout() const {
  return "no sample on " + nh_.resolveName("imu") +
         " for a second: start what publishes it, or remap imu";
}

std::string PriorInputs::wheelTimeout() const {
  if (!guess_) {
    return "no pose by wheels on " + nh_.resolveName("prior_odom") +
           " for a second: start what publishes it, or remap prior_odom";
  }
  return "tf has no " + parameters_.guess_frame_id + " -> " + parameters_.base_frame_id +
         " at the images' stamps, and so none from " + parameters_.odom_frame_id +
         ": start what publishes it, or correct guess_frame_id";
}

/// Of a topic.
void PriorInputs::describe(const Sensor& sensor, SourceFacts* facts) const {
  facts->fault = sensor.fault;
  facts->unused["of a frame that tf does not know"] = sensor.unmounted;
  if (sensor.newest_ns) facts->newest_s = toSeconds(*sensor.newest_ns - frame_ns_);
}

std::optional<SourceFacts> PriorInputs::imuFacts(const PriorSources& sources) const {
  if (!imu_.enabled()) return std::nullopt;
  SourceFacts facts;
  facts.counts = imu_.counts();
  facts.timeout = imuTimeout();
  facts.frames_without = sources.framesWithoutImu();
  describe(imu_sensor_, &facts);
  if (const Gyroscope* gyroscope = sources.gyroscope()) {
    facts.trusted = gyroscope->isTrusted();
    const ImuFaults& faults = gyroscope->faults();
    facts.unused["of a stamp twice"] = faults.doubled;
    facts.unused["too late"] = faults.late;
    facts.unused["not finite"] = faults.not_finite;
    facts.unused["saturated"] = faults.saturated;
    facts.unused["without acceleration"] = faults.without_acceleration;
  }
  return facts;
}

std::optional<SourceFacts> PriorInputs::wheelFacts(const PriorSources& sources) const {
  if (!guess_ && !wheels_.enabled()) return std::nullopt;
  SourceFacts facts;
  facts.timeout = wheelTimeout();
  facts.frames_without = sources.framesWithoutWheels();
  if (guess_) {
    facts.counts.received = num_guesses_;
    facts.counts.alive = T_guess_base_.has_value();
    facts.unused["missing in tf"] = missing_guesses_;
  } else {
    facts.counts = wheels_.counts();
    describe(wheel_sensor_, &facts);
  }
  if (const WheelOdometry* wheels = sources.wheels()) {
    facts.trusted = wheels->isTrusted();
    facts.unused["of a stamp twice"] = wheels->faults().doubled;
    facts.unused["too late"] = wheels->faults().late;
    facts.unused["not finite"] = wheels->faults().not_finite;
  }
  return facts;
}

}  // namespace point_line_odometry
