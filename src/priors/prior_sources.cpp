#include "priors/prior_sources.h"

#include <cstddef>
#include <vector>

namespace point_line_odometry {
namespace {

constexpr std::size_t kMaxEarlySamples = 2000;  // until the first frame

bool sameMounting(const std::optional<Eigen::Isometry3d>& known, const Eigen::Isometry3d& other) {
  return known && other.isApprox(*known, 1e-9);
}

/// To the source if there is one, else kept for it.
template <typename Sample, typename Source>
void add(const Sample& sample, std::optional<Source>* source, std::deque<Sample>* early) {
  if (*source) {
    (*source)->add(sample);
    return;
  }
  early->push_back(sample);
  if (early->size() > kMaxEarlySamples) early->pop_front();
}

template <typename Sample, typename Source>
void addEarly(std::deque<Sample>* early, Source* source) {
  for (const Sample& sample : *early) source->add(sample);
  early->clear();
}

}  // namespace

void PriorSources::setCamera(const Eigen::Isometry3d& T_base_camera) {
  if (sameMounting(T_base_camera_, T_base_camera)) return;
  T_base_camera_ = T_base_camera;
  mountImu();
  startWheels();
  startFloor();
}

void PriorSources::addImu(const ImuSample& sample, const Eigen::Isometry3d& T_base_imu) {
  if (!sameMounting(T_base_imu_, T_base_imu)) {
    T_base_imu_ = T_base_imu;
    mountImu();
  }
  add(sample, &gyroscope_, &early_imu_samples_);
}

bool PriorSources::hasImuUntil(std::int64_t stamp_ns) const {
  return !gyroscope_ || gyroscope_->covers(stamp_ns);
}

void PriorSources::addWheels(const OdometrySample& sample, const Eigen::Isometry3d& T_base_body) {
  if (!sameMounting(T_base_body_, T_base_body)) {
    T_base_body_ = T_base_body;
    startWheels();
  }
  add(sample, &wheels_, &early_wheel_samples_);
}

bool PriorSources::hasWheelsUntil(std::int64_t stamp_ns) const {
  return !wheels_ || wheels_->covers(stamp_ns);
}

std::optional<MotionPrior> PriorSources::takePrior(std::int64_t from_ns, std::int64_t to_ns) {
  std::vector<MotionPrior> priors;
  const auto take = [&](const auto& source) {
    const std::optional<MotionPrior> prior = source.between(from_ns, to_ns);
    if (prior) priors.push_back(*prior);
    return prior.has_value();
  };
  if (gyroscope_ && gyroscope_->isTrusted())
    without_imu_ = take(*gyroscope_) ? 0 : without_imu_ + 1;
  if (wheels_ && wheels_->isTrusted()) without_wheels_ = take(*wheels_) ? 0 : without_wheels_ + 1;
  if (floor_) take(*floor_);
  return fused(priors);
}

std::optional<TiltCorrection> PriorSources::takeTiltCorrection() {
  if (!gravity_) return std::nullopt;
  return gravity_->takeCorrection();
}

void PriorSources::update(const FrameResult& result) {
  if (gyroscope_) gyroscope_->update(result);
  if (gravity_) gravity_->update(result, *gyroscope_);
  if (wheels_) wheels_->update(result);
  if (floor_) floor_->update(result);
}

void PriorSources::discardSamples() {
  if (gyroscope_) gyroscope_->clear();
  if (wheels_) wheels_->clear();
  early_imu_samples_.clear();
  early_wheel_samples_.clear();
}

void PriorSources::restartGravity() {
  if (gravity_) gravity_->restart();
}

void PriorSources::continueGravity() {
  if (gravity_) gravity_->continueAfterGap(T_camera_imu());
}

void PriorSources::setParameters(const Parameters& parameters) {
  const ImuParameters before = parameters_.imu;
  const bool used_wheels = parameters_.wheels.enabled;
  parameters_ = parameters;
  if (parameters.imu.enabled != before.enabled) {
    startImu();
  } else if (parameters.imu.use_gravity != before.use_gravity) {
    startGravity();
  }
  if (parameters.wheels.enabled != used_wheels) startWheels();
  if (parameters.planar.enabled != floor_.has_value()) startFloor();
  if (gyroscope_) gyroscope_->setParameters(parameters.imu);
  if (gravity_) gravity_->setParameters(parameters.imu);
  if (wheels_) wheels_->setParameters(parameters);
  if (floor_) floor_->setParameters(parameters.planar);
}

/// Not before the poses of both, the camera and the IMU, are known.
void PriorSources::startImu() {
  gyroscope_.reset();
  gravity_.reset();
  if (!parameters_.imu.enabled || !T_base_imu_ || !T_base_camera_) return;
  gyroscope_.emplace(parameters_.imu, T_camera_imu().linear());
  startGravity();
  addEarly(&early_imu_samples_, &*gyroscope_);
}

/// What was estimated of the IMU does not depend on where it is.
void PriorSources::mountImu() {
  if (!gyroscope_) {
    startImu();
    return;
  }
  gyroscope_->setMounting(T_camera_imu().linear());
  continueGravity();
}

void PriorSources::startGravity() {
  gravity_.reset();
  if (gyroscope_ && parameters_.imu.use_gravity) gravity_.emplace(parameters_.imu, T_camera_imu());
}

/// As startImu().
void PriorSources::startWheels() {
  wheels_.reset();
  if (!parameters_.wheels.enabled || !T_base_body_ || !T_base_camera_) return;
  wheels_.emplace(parameters_, T_base_body_->inverse() * *T_base_camera_);
  addEarly(&early_wheel_samples_, &*wheels_);
}

void PriorSources::startFloor() {
  floor_.reset();
  if (parameters_.planar.enabled && T_base_camera_)
    floor_.emplace(parameters_.planar, *T_base_camera_);
}

}  // namespace point_line_odometry
